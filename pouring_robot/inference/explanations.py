"""What a diagnosis chooses from, for any model that predicts rows: nothing here knows the robot."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from pouring_robot.mechanism.arrays import FloatArray

BoolArray = NDArray[np.bool_]
_RANK = 1e-10


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
    """Residuals and all that may explain them, both without what the always free unknowns absorb.

    Attributes:
        residual: shape (m,): measured minus predicted over the noise.
        absorbed: orthonormal columns of what free unknowns absorb, shape (m, f); none in a compressed problem.
        backgrounds: usual small errors.
        explanations: forms of effects.
        constant: sum of squares of what no column reaches (left out by :meth:`compressed`).
    """

    residual: FloatArray
    absorbed: FloatArray
    backgrounds: tuple[Background, ...]
    explanations: tuple[Explanation, ...]
    constant: float = 0.0

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
        size = np.linalg.norm(free, axis=0)
        axes, values, _ = np.linalg.svd(free[:, size > 0.0] / size[size > 0.0], full_matrices=False)
        bare = cls(residual, axes[:, values > _RANK * values.max(initial=0.0)], (), ())
        return replace(
            bare,
            residual=bare.cleared(residual),
            backgrounds=tuple(replace(b, columns=bare.cleared(b.columns)) for b in backgrounds),
            explanations=tuple(replace(e, columns=bare.cleared(e.columns)) for e in explanations),
        )

    def cleared(self, values: FloatArray) -> FloatArray:
        """Return vectors (m,) or (m, k) without what the free unknowns absorb."""
        return np.asarray(values - self.absorbed @ (self.absorbed.T @ values))

    @property
    def known(self) -> frozenset[str]:
        """Ids of the effects that may be named."""
        return frozenset(item.effect for item in self.explanations if item.cause)

    def without(self, effects: Sequence[str]) -> Problem:
        """Return the problem with some effects taken out of the library."""
        kept = tuple(item for item in self.explanations if item.effect not in effects)
        return replace(self, explanations=kept)

    def compressed(self) -> Problem:
        """Return an equal problem of fewer equations: in an orthonormal basis of all columns.

        What is left of the residual is the same for every hypothesis.
        """
        groups = [*(b.columns for b in self.backgrounds), *(e.columns for e in self.explanations)]
        stacked = np.hstack([np.zeros((len(self.residual), 0)), *groups])
        size = np.linalg.norm(stacked, axis=0)
        if not (size > 0.0).any():
            return self
        unit = stacked[:, size > 0.0] / size[size > 0.0]
        basis, triangle, _ = scipy.linalg.qr(unit, mode="economic", pivoting=True, check_finite=False)
        basis = basis[:, np.abs(np.diag(triangle)) > _RANK]
        residual = basis.T @ self.residual
        rest = float(self.residual @ self.residual - residual @ residual)
        return Problem(
            residual,
            np.zeros((len(residual), 0)),
            tuple(replace(b, columns=basis.T @ b.columns) for b in self.backgrounds),
            tuple(replace(e, columns=basis.T @ e.columns) for e in self.explanations),
            self.constant + max(rest, 0.0),
        )
