"""Compiled: loops over samples. Each call takes a range of samples, so that threads share the work by ranges.

A sample's result depends on its own input only, never on the range or the thread it fell to.
"""

from pouring_robot.batch.kernels.algebra import dot, product, transposed
from pouring_robot.batch.kernels.closing import close_one
from pouring_robot.batch.kernels.compiler import compiled, outermost
from pouring_robot.batch.kernels.residuals import (
    Closures,
    Samples,
    Workspace,
    branch_end,
    copy,
    displace,
    nine,
    put,
    residual_of,
    three,
)
from pouring_robot.batch.structure import IntArray, Star
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.closure.status import CLOSED, GAP_TOO_LARGE

Rows = tuple[int, int]
"""The first of the samples that a call takes, and the one behind its last."""


@compiled
def load_joints(work: Workspace, joints: FloatArray) -> None:
    """Copy one sample's joints (C, J) into the workspace."""
    for i in range(joints.shape[0]):
        copy(joints[i], work.joints[i * joints.shape[1] : (i + 1) * joints.shape[1]])


@compiled
def load_state(work: Workspace, samples: Samples, row: int) -> None:
    """Copy one sample's pose and joints into the workspace."""
    for c in range(3):
        put(work.platform, 3 * c, three(samples.rotation[row, c], 0))
    put(work.platform, 9, three(samples.position[row], 0))
    load_joints(work, samples.joints[row])


@compiled
def load_drives(star: Star, work: Workspace, drives: FloatArray) -> None:
    """Put one sample's drive values over its joints."""
    for d in range(star.drives.shape[0]):
        work.joints[star.drives[d, 0] * star.revolute.shape[1] + star.drives[d, 1]] = drives[d]


@compiled
def place_errors(star: Star, work: Workspace, samples: Samples, row: int, first: int) -> None:
    """Put the errors of one sample into the workspace's sites.

    Errors that all samples share are put in place with sample ``first``, whether or not that one has an answer.
    """
    count, alone = samples.errors.shape[0], samples.site.shape[0] > 0
    if count == 0 or (count == 1 and not alone and row != first):
        return
    errors = samples.errors[row if count > 1 or alone else 0]
    for i in range(work.sites.shape[0]):
        for k in range(work.sites.shape[1]):
            copy(star.placements[i, k], work.sites[i, k])
    for site in range(errors.shape[0]):
        displace(star, work, samples.site[row] if alone else site, errors[site])


@compiled
def small_gaps(star: Star, work: Workspace, options: FloatArray) -> bool:
    """Return whether no loop is open by more than ``options[4]`` (m) and ``options[5]`` (rad)."""
    for i in range(star.revolute.shape[0]):
        shift, turned = three(work.shift[i], 0), three(work.turned[i], 0)
        if not (dot(shift, shift) <= options[4] ** 2 and dot(turned, turned) <= options[5] ** 2):
            return False
    return True


@compiled
def store(work: Workspace, closures: Closures, row: int) -> None:
    """Write pose and joints of the workspace."""
    chains, count = closures.joints.shape[1:]
    for c in range(3):
        closures.position[row, c] = work.platform[9 + c]
        copy(work.platform[3 * c : 3 * c + 3], closures.rotation[row, c])
    for i in range(chains):
        copy(work.joints[i * count : (i + 1) * count], closures.joints[row, i])


@outermost
def close_samples(
    star: Star,
    work: Workspace,
    samples: Samples,
    drives: FloatArray,
    options: FloatArray,
    max_iterations: int,
    closures: Closures,
    rows: Rows,
) -> None:
    """Close the samples whose status says that they may close, and say which do. See the engine's ``close``."""
    first, last = rows
    for row in range(first, last):
        place_errors(star, work, samples, row, first)
        if closures.status[row] != CLOSED:
            continue
        load_state(work, samples, row)
        load_drives(star, work, drives[row])
        code, closures.iterations[row] = close_one(star, work, options, max_iterations)
        if code == CLOSED and not small_gaps(star, work, options):
            code = GAP_TOO_LARGE
        closures.status[row] = code
        if code == CLOSED:
            store(work, closures, row)
            for i in range(star.revolute.shape[0]):
                residual_of(work, i, closures.residual[row, i])


@outermost
def carry_samples(
    star: Star, work: Workspace, samples: Samples, drives: FloatArray, chain: IntArray, closures: Closures, rows: Rows
) -> None:
    """Carry the end frame by one chain a sample (n,); of the start only the joints count."""
    first, last = rows
    for row in range(first, last):
        load_joints(work, samples.joints[row])
        load_drives(star, work, drives[row])
        place_errors(star, work, samples, row, first)
        r_a, _, origin = branch_end(star, work, chain[row])
        axes = product(r_a, transposed(nine(work.sites[chain[row], star.revolute.shape[1] + 1])))
        put(work.platform, 9, origin)
        for c in range(9):
            work.platform[c] = axes[c]
        store(work, closures, row)
