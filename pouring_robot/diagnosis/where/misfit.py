"""How much model and measurement disagree: against the noise, by component, between repeats, by region."""

from collections.abc import Iterator, Sequence

import numpy as np

from pouring_robot.diagnosis.discrepancy_processes import shown
from pouring_robot.diagnosis.where.free_residuals import Finding, FreeResiduals, size_text
from pouring_robot.diagnosis.where.ranks import larger
from pouring_robot.effects.conditions import Conditions
from pouring_robot.estimation.kinds import component_name
from pouring_robot.estimation.noise import commands
from pouring_robot.mechanism.arrays import BoolArray, FloatArray, rms

_FEWEST = 6
_LARGER = 1.3
_HARDLY = 0.02  # m of height, or rad of tilt, within which thirds do not differ
_STANDS_M = 1e-6  # x or y is constant if it varies by less, by rounding
_HEIGHTS = ("low", "at middle height", "high")
_TILTS = ("tilted back", "half tilted", "tilted far forward")


def overall(data: FreeResiduals, dof: int) -> Finding:
    """Return the misfit of everything against the noise, with ``dof`` degrees of freedom."""
    total = float(data.cleared @ data.cleared)
    p_value = data.noise.lack_of_fit_p(total, dof) if data.noise_known else None
    apart, kinds = data.cleared * data.sigma, np.unique(data.turning).tolist()  # lengths before rotations
    parts = [(rms(apart[data.turning == turning]), turning) for turning in kinds]
    sizes = " and ".join(f"{size_text(size, turning)} rms" for size, turning in parts)
    times = f": {np.sqrt(total / dof):.1f} times the noise" if data.noise_known else ""
    size, turning = parts[0]
    return Finding("lack of fit", f"Model and measurement disagree by {sizes}{times}.", size, p_value, turning=turning)


def components(data: FreeResiduals) -> list[Finding]:
    """Return the misfit of each component in the base's axes.

    Under noise its sum of squares is a weighted sum of chi-squares; Satterthwaite's approximation has the same mean and
    variance.
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
            p_value = data.p_value(float(values @ values) * mean / variance, mean**2 / variance)
        size = sigma * rms(values)
        name, turning = component_name(k), 3 <= k < 6
        noise = f" (noise {size_text(sigma, turning)})" if data.noise_known else ""
        sentence = f"{name} disagrees by {size_text(size, turning)} rms{noise}."
        found.append(Finding("component", sentence, size, p_value, name, turning=turning))
    return sorted(found, key=lambda f: (f.turning, -f.size))


def _along(data: FreeResiduals, k: int) -> tuple[FloatArray, FloatArray, float]:
    """Return residuals (n,) and the columns of the frames (n, f) along one axis of the base, and their noise.

    Only for rows with all three components measured: others cannot be rotated into these axes.
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
    """Return the scatter of repeats of one command against the noise; none with fewer than three degrees of freedom.

    The frames absorb the same in all rows of a command, so that deviations from its mean do not depend on them.
    """
    _, command = np.unique(commands(conditions.drives), axis=0, return_inverse=True)
    group = command.reshape(-1)[data.row] * (int(data.component.max()) + 1) + data.component
    _, group, counts = np.unique(group, return_inverse=True, return_counts=True)
    means = np.bincount(group, data.cleared) / counts
    repeated = np.flatnonzero(counts[group] > 1)
    group, apart = group[repeated], (data.cleared - means[group])[repeated]
    dof = group.size - np.unique(group).size
    chosen = ~data.turning[repeated]
    if dof < 3 or not chosen.any() or not data.noise_known:
        return []
    p_value = data.p_value(float(apart @ apart), dof)
    spare = int(chosen.sum()) - np.unique(group[chosen]).size
    size = float(np.sqrt(((apart * data.sigma[repeated])[chosen] ** 2).sum() / spare))
    sentence = (
        f"The same command gives poses {size_text(size)} rms apart when repeated "
        f"(noise {size_text(float(data.sigma[repeated][chosen][0]))}): something besides the pose changes."
    )
    return [Finding("repeats", sentence, size, p_value)]


def regions(data: FreeResiduals, given: Conditions) -> list[Finding]:
    """Return all regions with enough rows, the most significant first.

    Each row's score is its sum of squares over that expected of noise after the frames were fitted. The p-value is that
    of a one-sided Mann-Whitney test of a region's rows against the others; 1 unless it is also larger by 30 %.
    """
    n = len(given)
    expected = np.bincount(data.row, 1.0 - (data.nuisance.axes**2).sum(axis=1), n)
    score = np.bincount(data.row, data.cleared**2, n) / np.maximum(expected, 1e-12)
    lengths = ~data.turning
    squares = np.bincount(data.row[lengths], ((data.cleared * data.sigma) ** 2)[lengths], n)
    counts = np.bincount(data.row[lengths], minlength=n)
    counted = expected > 1e-9
    found = []
    for words, inside in _parts(given):
        here, there = inside & counted, ~inside & counted
        if min(here.sum(), there.sum()) < _FEWEST or not (counts[here].any() and counts[there].any()):
            continue
        p_value = larger(score[here], score[there])
        inside_m, outside_m = (float(np.sqrt(squares[part].sum() / counts[part].sum())) for part in (here, there))
        sizes = f"{size_text(inside_m)} rms there, {size_text(outside_m)} elsewhere"
        sentence = f"Errors are largest where the {given.causes.words.moved} is {words}: {sizes}."
        p_value = 1.0 if inside_m < _LARGER * outside_m else p_value
        found.append(Finding("region", sentence, inside_m, p_value, condition=words))
    return sorted(found, key=lambda finding: finding.p_value or 0.0)


def _parts(given: Conditions) -> Iterator[tuple[str, BoolArray]]:
    x, y, z = given.position_m.T
    heights, tilts = _thirds(z, _HEIGHTS), {} if given.tilt_rad is None else _thirds(given.tilt_rad, _TILTS)
    for high, there in heights.items():
        yield high, there
        yield from ((f"{high} and {tilted}", there & leaning) for tilted, leaning in tilts.items())
    yield from tilts.items()
    for name, values in (("x", x), ("y", y)):
        if np.ptp(values) > _STANDS_M:
            yield f"at small {name}", values < np.median(values)
            yield f"at large {name}", values >= np.median(values)


def _thirds(values: FloatArray, words: Sequence[str]) -> dict[str, BoolArray]:
    """Return the thirds of the rows by a value, in its order, by name; none where it hardly varies."""
    if np.ptp(values) < _HARDLY:
        return {}
    third = np.searchsorted(np.quantile(values, [1.0 / 3.0, 2.0 / 3.0]), values)
    return {word: third == k for k, word in enumerate(words)}
