"""How much model and measurement disagree: against the noise, by component, and against repeats of a command."""

import numpy as np

from pouring_robot.diagnosis.processes import shown
from pouring_robot.diagnosis.where.finding import COMPONENT, LACK_OF_FIT, REPEATS, Finding, size_text
from pouring_robot.diagnosis.where.residuals import FreeResiduals
from pouring_robot.effects.conditions import Conditions
from pouring_robot.estimation.instruments import component_name
from pouring_robot.mechanism.arrays import FloatArray

_SAME_DRIVE = 1e-6


def _rms(data: FreeResiduals, turning: bool) -> float:
    chosen = data.turning == turning
    return float(np.sqrt(((data.cleared * data.sigma)[chosen] ** 2).mean())) if chosen.any() else 0.0


def overall(data: FreeResiduals, freedoms: int) -> Finding:
    """Return the misfit of everything against the noise, of so many degrees of freedom."""
    total = float(data.cleared @ data.cleared)
    p_value = data.excess(total, freedoms) if data.noise_known else None
    parts = [(_rms(data, False), False)] + ([(_rms(data, True), True)] if data.turning.any() else [])
    sizes = " and ".join(f"{size_text(size, turning)} rms" for size, turning in parts)
    times = f": {np.sqrt(total / freedoms):.1f} times the noise" if data.noise_known else ""
    return Finding(LACK_OF_FIT, f"Model and measurement disagree by {sizes}{times}.", parts[0][0], p_value)


def components(data: FreeResiduals) -> list[Finding]:
    """Return the misfit of each component in the base's axes.

    Under noise its sum of squares is a weighted sum of chi-squares; Satterthwaite's has its mean and variance.
    """
    found = []
    for k in shown(data.component):
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
        name, turning = component_name(k), 3 <= k < 6
        noise = f" (noise {size_text(sigma, turning)})" if data.noise_known else ""
        sentence = f"{name} disagrees by {size_text(size, turning)} rms{noise}."
        found.append(Finding(COMPONENT, sentence, size, p_value, name, turning=turning))
    return sorted(found, key=lambda f: (f.turning, -f.size))


def _along(data: FreeResiduals, k: int) -> tuple[FloatArray, FloatArray, float]:
    """Return residuals (n,) and the columns of the frames (n, f) along one axis of the base, and their noise.

    Only of rows of which all three components were measured: others cannot be turned into these axes.
    """
    if k >= 6:
        own = np.flatnonzero(data.component == k)
        return data.cleared[own], data.nuisance.axes[own], float(data.sigma[own[0]])
    kind = np.flatnonzero(data.component // 3 == k // 3)
    order = kind[np.lexsort((data.component[kind], data.row[kind]))]
    rows, counts = np.unique(data.row[order], return_counts=True)
    whole = order[np.isin(data.row[order], rows[counts == 3])].reshape(-1, 3)
    direction = data.axes[:, k % 3]
    axes = np.einsum("ncf,c->nf", data.nuisance.axes[whole], direction)
    sigma = float(data.sigma[whole[0, 0]]) if len(whole) else 0.0
    return data.cleared[whole] @ direction, axes, sigma


def repeats(data: FreeResiduals, conditions: Conditions) -> list[Finding]:
    """Return how far repeats of one command lie apart against the noise; nothing with fewer than three differences.

    The frames absorb the same in all rows of a command, so that distances from its mean are free of the frames.
    """
    commands = np.round(conditions.drives / _SAME_DRIVE).astype(np.int64)
    _, command = np.unique(commands, axis=0, return_inverse=True)
    group = command.reshape(-1)[data.row] * (int(data.component.max()) + 1) + data.component
    _, group, counts = np.unique(group, return_inverse=True, return_counts=True)
    means = np.bincount(group, data.cleared) / counts
    repeated = np.flatnonzero(counts[group] > 1)
    group, apart = group[repeated], (data.cleared - means[group])[repeated]
    freedoms = group.size - np.unique(group).size
    chosen = ~data.turning[repeated]
    if freedoms < 3 or not chosen.any() or not data.noise_known:
        return []
    p_value = data.excess(float(apart @ apart), freedoms)
    spare = max(int(chosen.sum()) - np.unique(group[chosen]).size, 1)
    size = float(np.sqrt(((apart * data.sigma[repeated])[chosen] ** 2).sum() / spare))
    sentence = (
        f"The same command gives poses {size_text(size)} rms apart when repeated "
        f"(noise {size_text(float(data.sigma[repeated][chosen][0]))}): something besides the pose changes."
    )
    return [Finding(REPEATS, sentence, size, p_value)]
