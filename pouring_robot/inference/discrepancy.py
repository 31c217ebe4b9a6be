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
    hypothesis: Hypothesis, descriptions: Iterable[Description], residual: FloatArray, least_evidence: float = 3.0
) -> list[Structure]:
    """Return what structure descriptions find in the remainder of a hypothesis, most evident first.

    Args:
        hypothesis: of the whole problem, not of a compressed one.
        descriptions: to be tried.
        residual: shape (m,).
        least_evidence: what counts, in nats.
    """
    others, count = hypothesis.everything, len(residual)
    seen = hypothesis.problem.nuisance.cleared(residual)
    found = []
    for description in descriptions:
        columns = hypothesis.problem.nuisance.cleared(description.columns)
        worth = bayes_factor(columns, seen, others)
        if worth.evidence < least_evidence:
            continue
        scaled = worth.scale * columns
        precision = others.inner(scaled, scaled) + np.eye(scaled.shape[1])
        part = scaled @ scipy.linalg.solve(precision, others.inner(scaled, seen), assume_a="pos")
        size = float(np.sqrt(others.inner(part, part) / count))
        found.append(Structure(description, worth.evidence, size, part))
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
        hypothesis: of the whole problem.
        indices: of the items that make the cause.
        descriptions: to be tried.
    """
    residual, others = hypothesis.problem.residual, hypothesis.without(indices).everything
    own = hypothesis.worth(indices)
    effects = {hypothesis.items[k].effect for k in indices}
    best = Challenge("", -np.inf)
    for description in descriptions:
        if effects & description.same_as:
            continue
        margin = bayes_factor(hypothesis.problem.nuisance.cleared(description.columns), residual, others).evidence - own
        if margin > best.margin:
            best = Challenge(description.name, margin)
    return best
