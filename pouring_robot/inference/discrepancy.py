"""What is left: whether it has structure, and what it depends on. Descriptions, not causes.

Nothing here knows the robot.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg

from pouring_robot.inference.evidence import bayes_factor
from pouring_robot.inference.hypotheses import Hypothesis
from pouring_robot.mechanism.arrays import FloatArray


@dataclass(frozen=True, eq=False)
class Description:
    """A way in which something unknown may act.

    Attributes:
        where: what is moved, in words: ``seen place and turn``, ``drives`` …
        by: what it depends on, in words.
        columns: shape (m, k), whitened.
        same_as: effects that are as general as it is and say the same: it is no other explanation in their place.
    """

    where: str
    by: str
    columns: FloatArray
    same_as: frozenset[str] = frozenset()

    @property
    def name(self) -> str:
        """In words."""
        return f"{self.where} by {self.by}"


@dataclass(frozen=True, eq=False)
class Structure:
    """Structure that a description finds in what is left.

    Attributes:
        description: the description.
        evidence: log evidence for it, in nats.
        size: root mean square of what it explains, in noise standard deviations.
        part: what it explains, whitened, shape (m,).
    """

    description: Description
    evidence: float
    size: float
    part: FloatArray


def structures(
    hypothesis: Hypothesis, descriptions: Iterable[Description], least_evidence: float = 3.0
) -> list[Structure]:
    """Return what structure descriptions find in the remainder of a hypothesis, most evident first.

    Args:
        hypothesis: its remainder is searched.
        descriptions: to be tried.
        least_evidence: what counts, in nats.
    """
    found = []
    for description in descriptions:
        columns = hypothesis.problem.nuisance.cleared(description.columns)
        inner, projected = hypothesis.seen(columns)
        worth = bayes_factor(inner, projected)
        if worth.evidence < least_evidence:
            continue
        scale = worth.scale.main
        inner, projected = scale**2 * inner, scale * projected
        mean = scipy.linalg.solve(inner + np.eye(len(inner)), projected, assume_a="pos")
        size = float(np.sqrt(max(mean @ inner @ mean, 0.0) / len(columns)))
        found.append(Structure(description, worth.evidence, size, scale * columns @ mean))
    return sorted(found, key=lambda item: -item.evidence)


@dataclass(frozen=True)
class Challenge:
    """A description that explains better than a cause in its place.

    Attributes:
        description: in words.
        margin: by how much its log evidence is larger, in nats; negative where the cause explains better.
    """

    description: str
    margin: float


def challenge(hypothesis: Hypothesis, indices: Sequence[int], descriptions: Iterable[Description]) -> Challenge:
    """Return the description that would explain best in the place of a cause.

    A cause that is the right one beats descriptions, which are less specific. Where a description is clearly better,
    the cause is only the nearest neighbour of what is at work.

    Args:
        hypothesis: which the cause is part of.
        indices: of the items that make the cause.
        descriptions: to be tried.
    """
    rest, own = hypothesis.without(indices), hypothesis.worth(indices)
    effects = {hypothesis.items[k].effect for k in indices}
    best = Challenge("", -np.inf)
    for description in descriptions:
        if effects & description.same_as:
            continue
        margin = bayes_factor(*rest.seen(hypothesis.problem.nuisance.cleared(description.columns))).evidence - own
        if margin > best.margin:
            best = Challenge(description.name, margin)
    return best
