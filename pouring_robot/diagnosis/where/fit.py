"""How much model and measurement disagree: against the noise, by component, and against repeats of a command."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.stats
from numpy.typing import NDArray

from pouring_robot.diagnosis.where.terms import COMPONENTS, FreeResiduals
from pouring_robot.diagnosis.where.words import size_text
from pouring_robot.effects.conditions import Conditions
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.poses import MM, MRAD

_SAME_DRIVE = 1e-6
LACK_OF_FIT, REPEATS, COMPONENT, REGION = "lack of fit", "repeats", "component", "region"


@dataclass(frozen=True)
class Finding:
    """One thing said of the disagreement.

    Attributes:
        what: ``lack of fit``, ``repeats``, ``component``, ``condition`` or ``region``.
        component: in which component it is largest; "" for all together.
        condition: condition or region; "" for none.
        size: root mean square, or the span of what a condition does, in m or rad.
        turning: whether it counts in rad.
        p_value: probability that noise alone makes as much anywhere; None where the noise is not known.
        sentence: in words.
        rivals: conditions that went along and would explain it as well.
        share: of the sum of squares, what this condition explains beside those before it.
    """

    what: str
    component: str
    condition: str
    size: float
    turning: bool
    p_value: float | None
    sentence: str
    rivals: tuple[str, ...] = ()
    share: float = 1.0

    def as_json(self) -> dict[str, object]:
        """Return it as ``diagnosis.json`` holds it."""
        size = {"size_mrad": self.size / MRAD} if self.turning else {"size_mm": self.size / MM}
        out = {"what": self.what, "component": self.component, "condition": self.condition, **size}
        out |= {"p_value": self.p_value, "sentence": self.sentence}
        return out | ({"or": list(self.rivals)} if self.rivals else {})


@dataclass(frozen=True)
class LackOfFit:
    """Residuals against the noise.

    Attributes:
        chi_square: sum of squares over the noise.
        freedoms: equations less what the frames absorb.
        p_value: of so large a sum by noise alone; None where the noise is not known.
        repeats_p_value: of so large a misfit of poses given how far their own repeats scatter; None without repeats.
        repeated_rows: rows whose drives were commanded more than once.
    """

    chi_square: float
    freedoms: int
    p_value: float | None
    repeats_p_value: float | None
    repeated_rows: int


def _rms(data: FreeResiduals, turning: bool) -> float:
    chosen = (data.component >= 3) == turning
    return float(np.sqrt(((data.cleared * data.sigma)[chosen] ** 2).mean())) if chosen.any() else 0.0


def overall(data: FreeResiduals, freedoms: int) -> Finding:
    """Return the misfit of everything against the noise, of so many degrees of freedom."""
    total = float(data.cleared @ data.cleared)
    p_value = data.excess(total, freedoms) if data.noise_known else None
    parts = [(_rms(data, False), False)] + ([(_rms(data, True), True)] if data.full_pose else [])
    sizes = " and ".join(f"{size_text(size, turning)} rms" for size, turning in parts)
    times = f": {np.sqrt(total / freedoms):.1f} times the noise" if data.noise_known else ""
    return Finding(
        LACK_OF_FIT, "", "", parts[0][0], False, p_value, f"Model and measurement disagree by {sizes}{times}."
    )


def components(data: FreeResiduals) -> list[Finding]:
    """Return the misfit of each component in the fixed platform's axes.

    Under noise its sum of squares is a weighted sum of chi-squares; Satterthwaite's has its mean and variance.
    """
    found = []
    for k in range(6 if data.full_pose else 3):
        values, axes, sigma = _along(data, k)
        if len(values) < 2:
            continue
        inner = axes.T @ axes
        mean = len(values) - float(np.trace(inner))
        variance = len(values) - 2.0 * float(np.trace(inner)) + float((inner**2).sum())
        p_value = None
        if data.noise_known and mean > 0.5:
            p_value = data.excess(float(values @ values) * mean / variance, mean**2 / variance)
        size = sigma * float(np.sqrt((values**2).mean()))
        noise = f" (noise {size_text(sigma, k >= 3)})" if data.noise_known else ""
        sentence = f"{COMPONENTS[k]} disagrees by {size_text(size, k >= 3)} rms{noise}."
        found.append(Finding(COMPONENT, COMPONENTS[k], "", size, k >= 3, p_value, sentence))
    return sorted(found, key=lambda f: (f.turning, -f.size))


def _along(data: FreeResiduals, k: int) -> tuple[FloatArray, FloatArray, float]:
    """Return residuals (n,) and the columns of the frames (n, f) along one axis of the fixed platform, and their noise.

    Only of rows of which all three components were measured: others cannot be turned into these axes.
    """
    kind = np.flatnonzero(data.component // 3 == k // 3)
    order = kind[np.lexsort((data.component[kind], data.row[kind]))]
    rows, counts = np.unique(data.row[order], return_counts=True)
    whole = order[np.isin(data.row[order], rows[counts == 3])].reshape(-1, 3)
    direction = data.axes[:, k % 3]
    axes = np.einsum("ncf,c->nf", data.nuisance.axes[whole], direction)
    sigma = float(data.sigma[whole[0, 0]]) if len(whole) else 0.0
    return data.cleared[whole] @ direction, axes, sigma


def _alike(data: FreeResiduals, conditions: Conditions) -> tuple[NDArray[np.intp], FloatArray, NDArray[np.intp]]:
    """Return for each equation of a repeated command its group, and its distance from the group's mean.

    The frames absorb the same in all rows of a group, so that these distances are free of the frames.
    """
    commands = np.round(conditions.drives / _SAME_DRIVE).astype(np.int64)
    _, command = np.unique(commands, axis=0, return_inverse=True)
    group = command.reshape(-1)[data.row] * 6 + data.component
    _, group, counts = np.unique(group, return_inverse=True, return_counts=True)
    means = np.bincount(group, data.cleared) / counts
    repeated = np.flatnonzero(counts[group] > 1)
    return group[repeated], (data.cleared - means[group])[repeated], repeated


def repeats(data: FreeResiduals, conditions: Conditions) -> list[Finding]:
    """Return how far repeats of one command lie apart against the noise; nothing with fewer than three differences."""
    group, apart, repeated = _alike(data, conditions)
    freedoms = group.size - np.unique(group).size
    chosen = data.component[repeated] < 3
    if freedoms < 3 or not chosen.any() or not data.noise_known:
        return []
    p_value = data.excess(float(apart @ apart), freedoms)
    spare = max(int(chosen.sum()) - np.unique(group[chosen]).size, 1)
    size = float(np.sqrt(((apart * data.sigma[repeated])[chosen] ** 2).sum() / spare))
    sentence = (
        f"The same command gives poses {size_text(size, False)} rms apart when repeated "
        f"(noise {size_text(float(data.sigma[repeated][chosen][0]), False)}): something besides the pose changes."
    )
    return [Finding(REPEATS, "", "", size, False, p_value, sentence)]


def lack_of_fit(data: FreeResiduals, conditions: Conditions, p_value: float | None) -> LackOfFit:
    """Return residuals against the noise, whose ``p_value`` is known, and against repeats."""
    total, freedoms = float(data.cleared @ data.cleared), data.residual.size - data.nuisance.dof
    group, apart, repeated = _alike(data, conditions)
    pure = float(apart @ apart)
    pure_freedoms = group.size - int(np.unique(group).size)
    by_repeats = None
    if pure_freedoms >= 3 and freedoms > pure_freedoms and pure > 0.0:
        ratio = (total - pure) / (freedoms - pure_freedoms) / (pure / pure_freedoms)
        by_repeats = float(scipy.stats.f.sf(ratio, freedoms - pure_freedoms, pure_freedoms))
    return LackOfFit(total, freedoms, p_value, by_repeats, int(np.unique(data.row[repeated]).size))
