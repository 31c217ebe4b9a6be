"""Sobol indices of a finished study: the share of the scatter that each error causes, alone and with others."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from pouring_robot.exceptions import NoSolutionError
from pouring_robot.io.progress import Progress, say_nothing
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.sweeps.store import SweepStore, open_results

_RESAMPLES = 100
_READ_AT_ONCE = 4_000_000  # numbers, 32 MB


@dataclass(frozen=True, eq=False)
class SobolIndices:
    """Sobol indices, pooled over poses and coordinates."""

    first: FloatArray  # first-order index, shape (parameters,), as the next three
    total: FloatArray
    # half width of SALib's 95 % interval, averaged over outputs. It is a bootstrap, which assumes independent base
    # samples; those of a Sobol sequence fill space better, so that indices are several times more accurate
    first_confidence: FloatArray
    total_confidence: FloatArray
    first_m2: FloatArray  # first-order variance by coordinate, mean over the poses, shape (parameters, 3)
    dropped: int  # base samples in which a robot had no solution at some pose; left out there


def sobol_indices(store: SweepStore, progress: Progress = say_nothing) -> SobolIndices:
    r"""Return the Sobol indices of the displacement of a finished ``sobol`` study's first frame, by SALib.

    Each coordinate of the displacement at each pose is an output y with its own indices. They are pooled with the
    outputs' variances as weights (F. Gamboa et al., Sensitivity analysis for multidimensional and functional outputs,
    2014), so that the pooled first-order index is the share of the total scatter:

    .. math:: S_j = \sum_y \mathrm{Var}(y)\, S_{j,y} \Big/ \sum_y \mathrm{Var}(y)

    Raises:
        NoSolutionError: fewer than two base samples have a solution at every pose, or none moves the frame.
    """
    from SALib.analyze import sobol

    plan = store.plan
    count, lost = len(plan.names), np.zeros(plan.config.samples or 0, dtype=bool)
    problem = {"num_vars": count, "names": list(plan.names), "bounds": [[0.0, 1.0]] * count}
    settings = {"calc_second_order": False, "num_resamples": _RESAMPLES, "conf_level": 0.95}
    settings["seed"] = plan.config.seed + 1  # to SALib 0 means no seed
    weights = np.zeros(3)
    sums = np.zeros((4, 3, count))  # S1, ST and their confidence by axis, weighted with the variance
    for pose, outputs in enumerate(_outputs(store), start=1):
        blocks = outputs.reshape(lost.size, -1, 3)
        sound = np.isfinite(blocks).all(axis=(1, 2))
        lost |= ~sound
        for axis in range(3):
            values = blocks[sound, :, axis].ravel()
            # With one base sample indices are arbitrary, and the bootstrap interval has no width.
            variance = float(values.var()) if np.count_nonzero(sound) > 1 else 0.0
            if variance > 0.0:
                found = sobol.analyze(problem, values, **settings)
                sums[:, axis] += variance * np.array([found[key] for key in ("S1", "ST", "S1_conf", "ST_conf")])
                weights[axis] += variance
        progress("Sobol indices", pose, len(plan.poses))
    dropped = int(lost.sum())
    if not weights.any():
        raise NoSolutionError(
            f"the Sobol indices cannot be computed: of {plan.config.samples} base samples {dropped} have no "
            "solution, and fewer than two others do, or nothing moves in them; make the errors smaller"
        )
    first, total, first_confidence, total_confidence = sums.sum(axis=1) / weights.sum()
    return SobolIndices(first, total, first_confidence, total_confidence, sums[0].T / len(plan.poses), dropped)


def _outputs(store: SweepStore) -> Iterator[FloatArray]:
    """Yield the displacement of all samples at each pose, shape (samples, 3), in m."""
    displacement = open_results(store.folder).displacement
    at_once = max(1, _READ_AT_ONCE // (3 * store.plan.draws.count))
    for start in range(0, len(store.plan.poses), at_once):
        yield from displacement[:, start : start + at_once, 0].to_numpy().swapaxes(0, 1)
