"""Groups of parameters that a calibration dropped: they are not fitted, but their errors are still there."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from pouring_robot.estimation.frames.outer import FRAMES
from pouring_robot.estimation.map_fit import Fit
from pouring_robot.estimation.measurement import ModelledRows, Unknowns
from pouring_robot.estimation.residuals import MeasuredPoses, whiten
from pouring_robot.mechanism.arrays import FloatArray, Indices
from pouring_robot.mechanism.local_parameters import GeometricParameter
from pouring_robot.robot.tolerances import Tolerances


@dataclass(frozen=True, eq=False)
class UnfittedParameters:
    """Parameters besides those of a fit, with their effect on it where they are off by their tolerances."""

    rows: ModelledRows  # all rows, with the parameters of the fit and after them those dropped
    unknowns: Unknowns  # the fit's, with those dropped at zero
    theirs: Indices  # which of them were dropped, (p,)
    moves: FloatArray  # how far the unknowns are off along p independent directions, each a standard deviation, (u, p)

    @classmethod
    def beside(
        cls,
        fit: Fit,
        rows: ModelledRows,
        fit_data: tuple[Indices, MeasuredPoses],
        parameters: Sequence[GeometricParameter],
        tolerances: Tolerances,
    ) -> UnfittedParameters:
        """Return it for a fit, all rows, the fitted rows with what was measured in them, and what was dropped.

        By linear least squares about the fit: what was kept moves in their place. Where it cannot, rows that are
        explained without them have shown how large they are, so that less than the tolerances counts there.
        """
        used, seen = fit_data
        first = FRAMES + len(rows.model.parameters)
        rows = rows.with_parameters((*rows.model.parameters, *parameters))
        theirs = np.arange(first, first + len(parameters))
        unknowns = fit.unknowns.at(np.insert(fit.unknowns.values, [first] * theirs.size, 0.0))
        prior_std = rows.model.prior_std(tolerances, framed=seen.framed)
        off = whiten(seen, rows[used].linearise(unknowns)).derivatives * prior_std / fit.inflation
        fitted = np.delete(off, theirs, axis=1)
        moved = -np.linalg.solve(np.eye(fitted.shape[1]) + fitted.T @ fitted, fitted.T @ off[:, theirs])
        shown = off[:, theirs] + fitted @ moved
        information, directions = np.linalg.eigh(shown.T @ shown)
        moved = np.insert(moved, [first] * theirs.size, np.eye(theirs.size), axis=0)
        moved = moved @ (directions / np.sqrt(1.0 + information.clip(min=0.0)))
        return cls(rows, unknowns, theirs, prior_std[:, None] * moved)

    @property
    def kept_moves(self) -> FloatArray:
        """How far the unknowns of the fit move in place of those dropped, (u - p, p), in m and rad."""
        return np.delete(self.moves, self.theirs, axis=0)

    def covariances(self, of_fit: Iterable[FloatArray]) -> tuple[FloatArray, ...]:
        """Return the covariances of all unknowns, given those of the fit, which take what was dropped as exact.

        For a linear fit it is, by blocks, the inverse of the information of rows and tolerances on all of them.
        """
        others = np.setdiff1d(np.arange(len(self.moves)), self.theirs)
        added = self.moves @ self.moves.T
        return tuple(_added(added, others, covariance) for covariance in of_fit)


def _added(whole: FloatArray, some: Indices, covariance: FloatArray) -> FloatArray:
    """Return a covariance (u, u) with that of some unknowns added."""
    summed = whole.copy()
    summed[np.ix_(some, some)] += covariance
    return summed
