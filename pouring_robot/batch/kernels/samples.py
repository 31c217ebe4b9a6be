"""Compiled: loops over samples. Each call takes a range of samples, so that threads share the work by ranges.

A sample's result depends on its own input only, never on its range or thread.
"""

import math

from pouring_robot.batch.kernels.algebra import dot, product, transposed
from pouring_robot.batch.kernels.closing import close_one
from pouring_robot.batch.kernels.compiler import compiled, outermost
from pouring_robot.batch.kernels.residuals import (
    Closures,
    Samples,
    Workspace,
    branch_end,
    displace,
    nine,
    put,
    residual_of,
    three,
)
from pouring_robot.batch.structure import IntArray, Star
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.closure.status import CLOSED, GAP_TOO_LARGE, NOT_FINITE

_ROTATION_TOLERANCE = 1e-6
Rows = tuple[int, int]
"""The first of the samples of a call, and the one after its last."""


@compiled
def load_joints(star: Star, work: Workspace, joints: FloatArray) -> bool:
    """Copy one sample's joints (C, J) into the workspace; return whether they are finite."""
    total = 0.0
    chains, count = star.revolute.shape
    for i in range(chains):
        for k in range(count):
            work.joints[i * count + k] = joints[i, k]
            total += abs(joints[i, k])
    return math.isfinite(total)


@compiled
def load_state(star: Star, work: Workspace, samples: Samples, row: int) -> bool:
    """Copy one sample's pose and joints into the workspace; return whether they are finite and the axes orthonormal."""
    total, skew = 0.0, 0.0
    put(work.platform, 9, three(samples.position[row], 0))
    for c in range(3):
        total += abs(work.platform[9 + c])
        put(work.platform, 3 * c, three(samples.rotation[row, c], 0))
    for c in range(3):
        for k in range(c + 1):
            product = 1.0 if c == k else 0.0
            for m in range(3):
                product -= work.platform[3 * m + c] * work.platform[3 * m + k]
            skew += abs(product)
    return load_joints(star, work, samples.joints[row]) and math.isfinite(total) and skew < _ROTATION_TOLERANCE


@compiled
def load_drives(star: Star, work: Workspace, drives: FloatArray) -> bool:
    """Write one sample's drive values into its joints; return whether they are finite."""
    total = 0.0
    for d in range(star.drives.shape[0]):
        work.joints[star.drives[d, 0] * star.revolute.shape[1] + star.drives[d, 1]] = drives[d]
        total += abs(drives[d])
    return math.isfinite(total)


@compiled
def place_errors(star: Star, work: Workspace, samples: Samples, row: int, first: int) -> bool:
    """Apply the errors of one sample to the workspace's sites; return whether they are finite.

    Errors common to all samples are applied with sample ``first``.
    """
    count = samples.errors.shape[0]
    if count == 0:
        return True
    errors = samples.errors[row if count > 1 or samples.site.shape[0] > 0 else 0]
    total = 0.0
    for site in range(errors.shape[0]):
        for c in range(6):
            total += abs(errors[site, c])
    if count > 1 or samples.site.shape[0] > 0 or row == first:
        for i in range(work.sites.shape[0]):
            for k in range(work.sites.shape[1]):
                for c in range(12):
                    work.sites[i, k, c] = star.placements[i, k, c]
        for site in range(errors.shape[0]):
            displace(star, work, samples.site[row] if samples.site.shape[0] > 0 else site, errors[site])
    return math.isfinite(total)


@compiled
def small_gaps(star: Star, work: Workspace, options: FloatArray) -> bool:
    """Return whether no loop is open by more than ``options[4]`` (m) and ``options[5]`` (rad)."""
    for i in range(star.revolute.shape[0]):
        shift, turned = three(work.shift[i], 0), three(work.turned[i], 0)
        if not (dot(shift, shift) <= options[4] ** 2 and dot(turned, turned) <= options[5] ** 2):
            return False
    return True


@compiled
def store(star: Star, work: Workspace, closures: Closures, row: int, status: int) -> None:
    """Write pose and joints of the workspace, or NaN for a sample that is not closed."""
    good = status == CLOSED
    chains, count = star.revolute.shape
    closures.status[row] = status
    for c in range(3):
        closures.position[row, c] = work.platform[9 + c] if good else math.nan
        for k in range(3):
            closures.rotation[row, c, k] = work.platform[3 * c + k] if good else math.nan
    for i in range(chains):
        for k in range(count):
            closures.joints[row, i, k] = work.joints[i * count + k] if good else math.nan


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
    """Close samples. See the engine's ``close``."""
    first, last = rows
    for row in range(first, last):
        code, steps = NOT_FINITE, 0
        sound = load_state(star, work, samples, row)
        sound = load_drives(star, work, drives[row]) and sound
        if place_errors(star, work, samples, row, first) and sound:
            code, steps = close_one(star, work, options, max_iterations)
        if code == CLOSED and not small_gaps(star, work, options):
            code = GAP_TOO_LARGE
        store(star, work, closures, row, code)
        closures.iterations[row] = steps
        for i in range(star.revolute.shape[0]):
            residual_of(work, i, closures.residual[row, i])
        if code != CLOSED:
            closures.residual[row, :, :] = math.nan


@outermost
def carry_samples(
    star: Star, work: Workspace, samples: Samples, drives: FloatArray, chain: IntArray, closures: Closures, rows: Rows
) -> None:
    """Carry the end frame by one chain for each sample, (n,); of the start only the joints count."""
    first, last = rows
    for row in range(first, last):
        load_joints(star, work, samples.joints[row])
        load_drives(star, work, drives[row])
        sound = place_errors(star, work, samples, row, first)
        r_a, _, origin = branch_end(star, work, chain[row])
        axes = product(r_a, transposed(nine(work.sites[chain[row], star.revolute.shape[1] + 1])))
        put(work.platform, 9, origin)
        for c in range(9):
            work.platform[c] = axes[c]
        total = origin[0] + origin[1] + origin[2]
        for k in range(work.joints.size):
            total += work.joints[k]
        store(star, work, closures, row, CLOSED if sound and math.isfinite(total) else NOT_FINITE)
        closures.iterations[row] = 0
