"""Thresholds: what evidence an effect, structure or a process must have. Nothing here knows the robot.

The evidence that a name needs follows from the accepted rate of false names (docs/inference.md, "One number decides").
Chosen, not derived, are ``minor_evidence``, which a small effect needs if there is a large one, and all sizes; what
they are worth: docs/blind_trials.md, "What each choice is worth".
"""

from __future__ import annotations

from dataclasses import dataclass
from numbers import Real

import numpy as np
from scipy.special import ndtri

from pouring_robot.exceptions import BadInputError
from pouring_robot.inference.evidence import eigen, evidences
from pouring_robot.inference.hypotheses import Hypothesis
from pouring_robot.io.argument_checks import expect
from pouring_robot.io.seeds import CHANCE_SEED

LITTLE_NATS = 3.0
"""Odds of 20: less evidence than this is little, and an explanation that is behind by less is as good."""
CHANCE_DRAWS = 1000
_FEWEST_BEYOND = 10
"""Draws that must exceed a level to determine it: their number is then known to a third, and the level to 0.3 nats."""
_ROUNDING = 1e-13
"""Share of a column's square that rounding leaves of it where workmanship absorbs it completely."""
_POWER = 0.8


@dataclass(frozen=True)
class Thresholds:
    """Thresholds of evidence and size; a BadInputError where the rate of false names is not between 0 and 1."""

    # accepted rate of false names where nothing is missing. An effect that is absent has a Bayes factor of K or more
    # with a probability of at most 1 / K (Kerridge, Annals of Mathematical Statistics 34, 1963). As the forms of an
    # effect share its probability, an effect needs a Bayes factor of one over this rate
    false_names: float = 0.01
    # least evidence that an effect needs because many effects are tried, in nats (:func:`chance_level`)
    by_chance: float = 0.0
    most_effects: int = 5  # how many may be found
    # share of an effect's part that its main parameters must be able to explain; for this, ``most_cancelled``,
    # ``minor_share`` and ``minor_evidence`` see docs/inference.md, "What is no cause"
    least_main_share: float = 0.4
    # how many times larger than the whole gap an effect's part may be (root mean squares). Larger parts are cancelled
    # by others: such effects are no causes, but together fit something that is none of them
    most_cancelled: float = 3.0
    structure_size: float = 0.3  # least size of structure in the residual, in noise standard deviations
    # its least size as a share of the largest named effect whose real form may differ: less is an error of that form
    structure_share: float = 0.05
    # an effect smaller than this share of the largest one needs ...
    minor_share: float = 0.12
    # ... this evidence, in nats, and as much more than a larger one whose size varies: otherwise it corrects that one's
    # form. Chosen: the rate of false names concerns noise, not forms that are not quite right
    minor_evidence: float = 25.0

    def __post_init__(self) -> None:
        said = "the rate of false names must be a share between 0 and 1"
        expect(self.false_names, Real, said)
        if not 0.0 < self.false_names < 1.0:
            raise BadInputError(f"{said}, not {self.false_names:g}")
        object.__setattr__(self, "false_names", float(self.false_names))  # JSON cannot encode NumPy numbers

    @property
    def least_evidence(self) -> float:
        """Log evidence that one more effect needs to be named, in nats."""
        return max(self.evidence_of_one_in(1), self.by_chance)

    def evidence_of_one_in(self, tried: int) -> float:
        """Return the log evidence that one of ``tried`` explanations needs, in nats.

        For structure in the residual, a process against a cause, and workmanship where nothing else is found.
        """
        return float(np.log(max(tried, 1) / self.false_names))

    @property
    def hidden(self) -> float:
        """Sum of squares, in noise variances, that data like these hardly show; an effect that leaves less is as good.

        The part d (noise variances) that one effect leaves of another's makes their log evidences differ by d/2 with a
        standard deviation of √d. It shows if that reaches the required evidence four times in five, the usual power of
        a test (Cohen, Statistical power analysis, 1988).
        """
        beyond = float(ndtri(_POWER))
        return float((beyond + np.sqrt(beyond**2 + 2.0 * self.evidence_of_one_in(1))) ** 2)


DEFAULT_THRESHOLDS = Thresholds()


def chance_level(null: Hypothesis, rate: float, draws: int = CHANCE_DRAWS) -> float:
    """Return the log evidence that the best cause exceeds at a given rate where none is at work, in nats.

    A parametric bootstrap at the fitted null: noise and workmanship at their most probable level, and nothing else.
    The inner products of columns with a residual of the null's covariance C are normal, with the columns' inner
    products through the inverse of C as covariance, so that no residual has to be drawn.

    A level that fewer than ten draws would determine is extrapolated from that of ten. Under the null a log evidence of
    x is exp(-x) times as likely as where something is at work, where more is no likelier than less. So of the draws
    that exceed a level at most a share of 1/e exceeds it by a nat or more.
    """
    problem, every = null.problem, np.arange(len(null.problem.gram.projected), dtype=np.intp)
    inner = null.everything.inner(every, every)
    conditional, unconditional = inner.diagonal(), problem.gram.columns.diagonal()
    lengths = np.sqrt(np.where(conditional > _ROUNDING * unconditional, conditional, 0.0))
    inverse = np.divide(1.0, lengths, out=np.zeros(len(conditional)), where=lengths > 0.0)
    # The symmetric root: any other depends on the signs and order of eigenvectors, which differ between libraries.
    # Columns are scaled to equal length first, as the root of the longest one's rounding may exceed the shortest.
    squared, axes = eigen(inner * np.outer(inverse, inverse))
    spread = lengths[:, None] * ((axes * np.sqrt(np.maximum(squared, 0.0))) @ axes.T)
    projected = spread @ np.random.default_rng(CHANCE_SEED).normal(size=(len(inner), draws))
    largest = np.zeros(draws)
    for item in problem.explanations:
        if item.cause and problem.shown(item):
            places = problem.places(item)
            found = evidences(
                inner[places[:, None], places],
                projected[places],
                item.main,
                problem.shaping_units[item.key],
            )
            largest = np.maximum(largest, found + problem.log_priors[item.effect])
    rate_of_draws = max(rate, min(_FEWEST_BEYOND / draws, 1.0))
    return float(np.quantile(largest, 1.0 - rate_of_draws) + np.log(rate_of_draws / rate))
