"""What a diagnosis chooses from, for any model that predicts rows: nothing here knows the robot."""

from __future__ import annotations

import functools
from collections.abc import Hashable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pouring_robot.inference.nuisance import Nuisance, basis, unit
from pouring_robot.mechanism.arrays import FloatArray

BoolArray = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Explanation:
    """One form of one effect: the columns it can add to the prediction.

    Attributes:
        effect: id of the effect; several explanations are forms of the same one.
        form: which form; together with the effect it names the explanation.
        columns: shape (m, k): whitened signature of each parameter times the parameter's usual size.
        main: shape (k,): parameters that make the effect; the others only shape it and do not stand alone.
        cause: whether it may be named. What is no cause is there to be fitted and to explain, such as small errors that
            another effect brings to light.
        largest: how many times their usual size the parameters can be.
        small: up to how many times their usual size they are no more than what workmanship leaves, and are not named
            beside another cause.
    """

    effect: str
    form: str
    columns: FloatArray
    main: BoolArray
    cause: bool = True
    largest: float = np.inf
    small: float = 0.0

    @property
    def key(self) -> tuple[str, str]:
        """Effect and form."""
        return self.effect, self.form


@dataclass(frozen=True, eq=False)
class Background:
    """Small errors that are usually there: fitted beside every explanation, never named while others explain.

    Attributes:
        effect: id of the effect that the same errors are called when they are all there is.
        columns: shape (m, k), times the usual size.
    """

    effect: str
    columns: FloatArray


@dataclass(frozen=True, eq=False)
class Problem:
    """Residuals and all that may explain them, both without what the always free unknowns explain.

    Attributes:
        residual: shape (m,): measured minus predicted over the noise.
        nuisance: what free unknowns explain; nothing in a compressed problem.
        backgrounds: usual small errors.
        explanations: forms of effects.
        constant: sum of squares of what no column reaches (left out by :meth:`compressed`).
    """

    residual: FloatArray
    nuisance: Nuisance
    backgrounds: tuple[Background, ...]
    explanations: tuple[Explanation, ...]
    constant: float = 0.0

    @functools.cached_property
    def found(self) -> dict[Hashable, Any]:
        """What hypotheses worked out once for all that are alike."""
        return {}

    @functools.cached_property
    def _beside(self) -> dict[tuple[tuple[str, str], float], Problem]:
        """Problems beside an explanation, as far as they were asked for."""
        return {}

    def beside(self, item: Explanation, scale: float) -> Problem:
        """Return the problem that is left beside an explanation at a scale, in far fewer equations.

        Noise and explanation together are whitened away, so that what is found beside it is found by the same algebra.
        The determinant of their covariance, which all hypotheses with it share, is in the constant.
        """
        key = item.key, scale
        if key not in self._beside:
            axes, sizes, _ = np.linalg.svd(scale * item.columns, full_matrices=False)
            shrunk = 1.0 - 1.0 / np.sqrt(1.0 + sizes**2)

            def whitened(columns: FloatArray) -> FloatArray:
                return np.asarray(columns - (axes * shrunk) @ (axes.T @ columns))

            constant = self.constant + float(np.log1p(sizes**2).sum())
            others = (e for e in self.explanations if e.key != item.key)
            self._beside[key] = Problem(
                whitened(self.residual),
                Nuisance(np.zeros((len(self.residual), 0))),
                tuple(replace(b, columns=whitened(b.columns)) for b in self.backgrounds),
                tuple(replace(e, columns=whitened(e.columns)) for e in others),
                constant,
            ).compressed()
        return self._beside[key]

    @classmethod
    def build(
        cls,
        residual: FloatArray,
        free: FloatArray,
        backgrounds: Sequence[Background],
        explanations: Sequence[Explanation],
    ) -> Problem:
        """Return the problem beside free unknowns, which are always fitted and never named.

        Args:
            residual: shape (m,).
            free: columns of the free unknowns, shape (m, f).
            backgrounds: usual small errors.
            explanations: forms of effects.
        """
        nuisance = Nuisance.of(free)
        return cls(
            nuisance.cleared(residual),
            nuisance,
            tuple(replace(b, columns=nuisance.cleared(b.columns)) for b in backgrounds),
            tuple(replace(e, columns=nuisance.cleared(e.columns)) for e in explanations),
        )

    @functools.cached_property
    def keys(self) -> frozenset[tuple[str, str]]:
        """Effects and forms of all explanations."""
        return frozenset(item.key for item in self.explanations)

    @property
    def known(self) -> frozenset[str]:
        """Ids of the effects that may be named."""
        return frozenset(item.effect for item in self.explanations if item.cause)

    def compressed(self) -> Problem:
        """Return an equal problem of fewer equations: in an orthonormal basis of all columns.

        What is left of the residual is the same for every hypothesis.
        """
        groups = [*(b.columns for b in self.backgrounds), *(e.columns for e in self.explanations)]
        stacked = np.hstack([np.zeros((len(self.residual), 0)), *groups])
        axes = basis(unit(stacked))
        if not axes.shape[1]:
            return self
        residual = axes.T @ self.residual
        rest = float(self.residual @ self.residual - residual @ residual)
        return Problem(
            residual,
            Nuisance(np.zeros((len(residual), 0))),
            tuple(replace(b, columns=axes.T @ b.columns) for b in self.backgrounds),
            tuple(replace(e, columns=axes.T @ e.columns) for e in self.explanations),
            self.constant + max(rest, 0.0),
        )
