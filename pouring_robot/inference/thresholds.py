"""When something counts: what an effect, structure or a process must be worth. Nothing here knows the robot.

What evidence a name needs follows from the accepted rate of false names (docs/inference.md, "One number decides").
Chosen, and not derived, are ``minor_evidence``, which a small effect beside a large one needs, and all sizes; what they
are worth: docs/blind_trials.md, "What each choice is worth".
"""

from __future__ import annotations

from dataclasses import dataclass
from numbers import Real

import numpy as np
from scipy.special import ndtri

from pouring_robot.exceptions import BadInputError
from pouring_robot.inference.evidence import eigen, evidences
from pouring_robot.inference.hypotheses import Hypothesis
from pouring_robot.io.given import expect
from pouring_robot.io.seeds import CHANCE_SEED

LITTLE_NATS = 3.0
"""Odds of 20: what is worth or tells less is little, and what is behind by less as good."""
CHANCE_DRAWS = 1000
_FEWEST_BEYOND = 10
"""Draws that must be beyond a level to tell it: their number is then known to a third, and the level to 0.3 nats."""
_ROUNDING = 1e-13
"""Of a column's own square, what is left of it beside workmanship that takes it up whole."""
_POWER = 0.8


@dataclass(frozen=True)
class Thresholds:
    """When something counts; a BadInputError where the rate of false names is no share."""

    # rate of false names that is accepted where nothing is missing. What is not at work is seen with a Bayes factor of
    # K at most once in K times (Kerridge, Annals of Mathematical Statistics 34, 1963); with the forms of an effect
    # sharing its probability, one over this rate is what an effect must be worth
    false_names: float = 0.01
    # what it must be worth at least because so many effects are tried, in nats (:func:`chance_level`)
    by_chance: float = 0.0
    most_effects: int = 5  # how many may be found
    # share of an effect's part that its main parameters must be able to make; of this, ``most_cancelled``,
    # ``minor_share`` and ``minor_evidence`` see docs/inference.md, "What is no cause"
    least_main_share: float = 0.4
    # how many times larger than the whole gap an effect's part may be (root mean squares): what is larger is undone by
    # others, and they are no causes but ways to fit together what is none of them
    most_cancelled: float = 3.0
    structure_size: float = 0.3  # least size of structure in what is left, in noise standard deviations
    # its least share of the largest named effect with a form that nature need not keep to: below, it is that form
    structure_share: float = 0.05
    # an effect smaller than this share of the largest one must be worth, ...
    minor_share: float = 0.12
    # ... in nats, so much by itself, and so much more than a larger one whose size varies: else it corrects that one's
    # form. Chosen: the rate of false names is of noise, and says nothing of forms that are not quite right
    minor_evidence: float = 25.0

    def __post_init__(self) -> None:
        said = "the rate of false names is a share between 0 and 1"
        expect(self.false_names, Real, said)
        if not 0.0 < self.false_names < 1.0:
            raise BadInputError(f"{said}, not {self.false_names:g}")
        object.__setattr__(self, "false_names", float(self.false_names))  # JSON takes no numbers of numpy's

    @property
    def least_evidence(self) -> float:
        """Log evidence that one more effect must be worth to be named, in nats."""
        return max(self.evidence_of_one_in(1), self.by_chance)

    def evidence_of_one_in(self, tried: int) -> float:
        """Return the log evidence that one of so many things must be worth, in nats.

        Structure in what is left, a process against a cause, workmanship where nothing else is found.
        """
        return float(np.log(max(tried, 1) / self.false_names))

    @property
    def hidden(self) -> float:
        """Sum of squares, in noise variances, that such data hardly show; who leaves no more explains as well.

        What an effect leaves of another one's part, d in noise variances, makes their log evidences differ by d/2 with
        a standard deviation of √d. It is seen if that reaches the evidence asked for four times in five, the usual
        power of a test (Cohen, Statistical power analysis, 1988).
        """
        beyond = float(ndtri(_POWER))
        return float((beyond + np.sqrt(beyond**2 + 2.0 * self.evidence_of_one_in(1))) ** 2)


DEFAULT_THRESHOLDS = Thresholds()


def chance_level(null: Hypothesis, rate: float, draws: int = CHANCE_DRAWS) -> float:
    """Return the log evidence that the best cause exceeds at a rate where none is at work, in nats.

    A parametric bootstrap at the fitted null: noise and workmanship at their most probable level, and nothing else.
    Inner products of columns with a residual drawn from the null's covariance C are normal with the columns' own inner
    products through C for covariance, so that no residual has to be drawn.

    What fewer than ten draws would tell follows from what ten tell: under the null a log evidence of x is exp(-x) times
    as likely as where something is at work, where more is no likelier than less, so that it is exceeded by a nat more
    in a share of 1/e at most.
    """
    problem, every = null.problem, np.arange(len(null.problem.gram.projected), dtype=np.intp)
    inner = null.everything.inner(every, every)
    left, own = inner.diagonal(), problem.gram.columns.diagonal()
    lengths = np.sqrt(np.where(left > _ROUNDING * own, left, 0.0))
    inverse = np.divide(1.0, lengths, out=np.zeros(len(left)), where=lengths > 0.0)
    # The symmetric root: any other depends on the signs and the order of axes that this machine's library chose; of
    # columns of one length, as the root of the longest's rounding may be more than the shortest.
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
    told = max(rate, min(_FEWEST_BEYOND / draws, 1.0))
    return float(np.quantile(largest, 1.0 - told) + np.log(told / rate))
