"""Checks of single rows and of their order: gross errors, poses out of reach, jumps of the measuring set-up.

A robot's own errors vary smoothly with pose and conditions, or are the answer to a smooth error of its drives, which
near a singular pose is large. A wrong row is neither. So residuals are looked at twice: in the pose, and as the
drive errors that would explain them; from both, what a low-order function of pose and conditions explains is taken.
"""

from collections.abc import Iterator, Sequence

import numpy as np
import pinocchio as pin

from pouring_robot.campaign import columns
from pouring_robot.campaign.data import Campaign
from pouring_robot.campaign.nominal import PoseStack
from pouring_robot.checks.flags import DataFlag, FlagCode, Severity, found
from pouring_robot.checks.units_and_axes import Comparison
from pouring_robot.estimation.frames.fit import FrameFit
from pouring_robot.estimation.frames.outer import OuterFrames
from pouring_robot.estimation.robust import huber_weights, robust_sigma, tukey_weights
from pouring_robot.exceptions import FrameFitError
from pouring_robot.io.units import MM, MRAD, shown_in
from pouring_robot.mechanism.arrays import FloatArray, Indices, evenly
from pouring_robot.mechanism.local_parameters import GeometricParameter, drive_parameters
from pouring_robot.robot.description.definition import RobotDefinition
from pouring_robot.robot.description.drawing import Drawing
from pouring_robot.robot.parameter_catalogue import ParameterCatalogue

GROSS_SIGMAS = 8.0
"""A row holds a gross error beyond so many robust deviations: in the pose, in the drives that would explain it, and of
what errors of all joints explain. The deviation is that of a row against what the others foretell."""
_PLAIN = 1.0
_IMPOSSIBLE_M, _IMPOSSIBLE_RAD = 0.05, 0.15
_JUMP_SIGMAS = 5.0
"""A step counts beyond this many deviations of one row; a steady drift, taken for a step, stays below three."""
_JUMP_WINDOW = 10
_JUMP_PLACES = 400
_TIMES_BETTER = 3.0  # rows that were moved together agree with frames of their own, and as the others do with theirs
_LARGE_JUMP_M, _LARGE_JUMP_RAD = 1e-3, 2e-3
_FEWEST = 12
_TELLING_ROWS = 1000  # many times the errors of joints there are
_RIDGE = 1e-3
_ROWS_PER_TERM = 4
_NINETY_PER_CENT = 1.645  # deviations of a normal error that nine in ten stay within
_VARIES = 1e-6  # of rotations, root mean square; below it they stand still
_GAP_SIGMAS = 100.0  # of the rows that agree; tails of a crooked robot have no gap so wide
_SLOW = ("time", "temperature")


def check_rows(campaign: Campaign, drawing: Drawing, data: Comparison, fit: FrameFit) -> Iterator[DataFlag]:
    """Yield gross errors, unreachable poses and jumps, given data whose mistakes of units and frames are undone."""
    rows = np.flatnonzero(data.poses.complete & campaign.usable)
    if rows.size < _FEWEST or data.inverted:
        return
    score = scores_of(campaign, drawing, data, fit)
    distance = np.linalg.norm(np.nan_to_num(fit.position_residual_m), axis=1)
    angle = np.zeros(len(campaign))
    plain = distance / max(fit.position_scale_m, 1e-12)
    if fit.rotation_residual_rad is not None:
        angle = np.linalg.norm(np.nan_to_num(fit.rotation_residual_rad), axis=1)
        plain = np.maximum(plain, angle / max(fit.rotation_scale_rad or 0.0, 1e-12))
    # A row that is no worse than others before any smoothing has to stand out twice as far after it.
    wrong = np.flatnonzero((score > GROSS_SIGMAS) & ((plain > _PLAIN) | (score > 2.0 * GROSS_SIGMAS)))
    far = (distance > _IMPOSSIBLE_M) | (angle > _IMPOSSIBLE_RAD)
    if wrong.size:  # near the edge of reach errors of joints are not smooth, but the other rows tell of them
        beyond = np.minimum(_beyond_joints(campaign, drawing, data, fit, wrong), score[wrong])
        # Under conditions that no other row had nobody knows what is right.
        uncertain = np.where(far[wrong], 0.0, foretelling(campaign, data.poses, wrong))
        wrong = wrong[beyond > GROSS_SIGMAS * np.sqrt(1.0 + uncertain)]
    apart = np.union1d(wrong, np.flatnonzero(plain > GROSS_SIGMAS))
    single = np.intersect1d(wrong, _not_together(data, fit, apart, campaign.metadata.metres_per_rad))
    jumps = list(_jumps(campaign, data, fit, single))
    for row in single if jumps else wrong:
        yield _gross_error(
            campaign, int(row), float(distance[row]), float(angle[row]), float(score[row]), bool(far[row])
        )
    yield from jumps


def scores_of(campaign: Campaign, drawing: Drawing, data: Comparison, fit: FrameFit) -> FloatArray:
    """Return how far each row is from what a smooth error of the robot explains, (n,), in robust deviations.

    The lesser of two: how far its pose is off, and how far the drive errors that would explain it are off. Near a
    singular pose the first is large for a sound row, but not the second.
    """
    terms, pose, floors = _residuals(campaign, data, fit)
    in_pose = np.max([_unexplained(terms, pose[:, k], floor) for k, floor in enumerate(floors)], axis=0)
    from_base = OuterFrames(pin.SE3.Identity(), fit.frames.T_end_target)
    effect = target_effect(drawing, data.drives, from_base, drive_parameters(drawing.mechanism))
    units = [drive.unit for drive in campaign.robot.drives]
    drives = drive_errors(effect, units, pose, floors[0] / floors[-1])
    in_drives = np.max([_unexplained(terms, errors, floors[0]) for errors in drives.T], axis=0)
    return np.asarray(np.minimum(in_pose, in_drives), dtype=np.float64)


def _beyond_joints(campaign: Campaign, drawing: Drawing, data: Comparison, fit: FrameFit, rows: Indices) -> FloatArray:
    """Return how far rows (k,) are from what errors of all joints explain, (k,), in robust deviations.

    A deviation is that of the component: beside errors of joints, or beside smooth errors where these explain more, as
    where drives are off. Infinite where the campaign is too short to tell; of a long one some rows do.
    """
    smooth, pose, floors = _residuals(campaign, data, fit)
    used = np.union1d(rows, evenly(len(campaign), _TELLING_ROWS))
    effect, small = joint_effect(campaign.robot, drawing, data.drives[used], fit.frames)
    frames = fit.frames.jacobian(data.poses[used]) * np.tile([MM] * 3 + [MRAD] * 3, 2)
    turn = np.kron(np.eye(2), fit.frames.T_tracker_base.rotation.T)
    terms = (turn @ np.concatenate([effect * small, frames], axis=2))[:, : len(floors)] / np.array(floors)[:, None]
    terms, residual = terms.reshape(used.size * len(floors), -1), pose[used] / floors
    known = np.isfinite(terms).all(axis=1) & np.isfinite(residual.ravel())
    if known.sum() < _ROWS_PER_TERM * np.linalg.matrix_rank(terms[known]):
        return np.full(rows.size, np.inf)
    _, left, _ = _robust_fit(terms, residual.ravel(), 1.0)
    scores = []
    for k, floor in enumerate(floors):
        size, deviation = _sized(left.reshape(residual.shape)[:, k], 1.0)
        near = _leftover(smooth, pose[:, k], floor)[1] / floor
        scores.append(size / min(deviation, near))
    return np.asarray(np.max(scores, axis=0)[np.searchsorted(used, rows)])


def _residuals(
    campaign: Campaign, data: Comparison, fit: FrameFit, *, with_time: bool = True
) -> tuple[FloatArray, FloatArray, list[float]]:
    """Return the smooth terms, residuals in fixed-platform axes, (n, 3) or (n, 6), in m and rad, and their noise.

    A missing cell is filled by what the other rows say of it; the noise is that of each column.
    """
    terms, stated = _smooth_terms(campaign, data.poses, with_time=with_time), campaign.metadata
    seen = [(fit.position_residual_m, stated.sigma_position_m or 1e-6)]
    if fit.rotation_residual_rad is not None:
        seen.append((fit.rotation_residual_rad, stated.sigma_rotation_rad or 1e-6))
    whole = (np.column_stack([_filled(terms, column, noise) for column in residual.T]) for residual, noise in seen)
    turned = [residual @ fit.frames.T_tracker_base.rotation for residual in whole]
    return terms, np.concatenate(turned, axis=1), np.repeat([noise for _, noise in seen], 3).tolist()


def _gross_error(campaign: Campaign, row: int, distance: float, angle: float, score: float, far: bool) -> DataFlag:
    names = (*columns.POSITION, *(columns.ROTATION if campaign.full_pose else ()))
    off = f"{distance * 1e3:.3g} mm" + (f" and {angle * 1e3:.3g} mrad" if campaign.full_pose else "")
    metrics = {"distance_mm": distance * 1e3, "angle_mrad": angle * 1e3, "deviations": score}
    code, said = FlagCode.UNREACHABLE_POSE, f"the drives cannot reach the measured pose; it is {off} from theirs"
    if not far:
        others = f"{score:.0f} robust deviations from what the other rows say of its errors"
        code, said = FlagCode.OUTLIER, f"gross error, {off} from the nominal robot, {others}"
    return found(campaign, code, f"line {campaign.lines[row]}: {said}", [row], names, metrics)


def _not_together(data: Comparison, fit: FrameFit, rows: Indices, metres_per_rad: float) -> Indices:
    """Return rows (k,) without those, a tenth of all or more, that frames of their own explain.

    There tracker or target were moved: once, or several times.
    """
    fewest = max(_JUMP_WINDOW, len(data.poses) // 10)
    if rows.size < fewest:
        return rows
    try:
        own = data[rows].fit(metres_per_rad)
    except FrameFitError:  # too few whole positions
        return rows
    before, after = _sizes(fit, metres_per_rad), _sizes(own, metres_per_rad)
    apart = after > np.minimum(before[rows] / _TIMES_BETTER, 2.0 * GROSS_SIGMAS * np.median(before))
    if np.count_nonzero(~apart) >= fewest:
        return _not_together(data, fit, rows[apart], metres_per_rad)
    halves = np.array_split(rows, 2) if rows.size >= 2 * fewest else []
    return np.concatenate([_not_together(data, fit, half, metres_per_rad) for half in halves]) if halves else rows


def _sizes(fit: FrameFit, metres_per_rad: float) -> FloatArray:
    """Return what frames leave of each row, (n,), in m, an angle by the length that weighs as much."""
    turn = 0.0 if fit.rotation_residual_rad is None else np.nan_to_num(fit.rotation_residual_rad)
    left = np.hypot(np.nan_to_num(fit.position_residual_m), metres_per_rad * turn)
    return np.asarray(np.linalg.norm(left, axis=1))


def _jumps(campaign: Campaign, data: Comparison, fit: FrameFit, wrong: Indices) -> Iterator[DataFlag]:
    """Yield the largest lasting step of each session's residuals, if there is a clear one."""
    terms, pose, floors = _residuals(campaign, data, fit, with_time=False)
    pose[wrong] = np.nan
    inliers = np.asarray(np.isfinite(pose).all(axis=1) & np.isfinite(terms).all(axis=1), dtype=np.bool_)
    for session, members in campaign.rows_by_session().items():
        rows = members[inliers[members]]
        # With more terms than a quarter of the rows, they would explain any step.
        kept = terms[:, : max(1, rows.size // 4)]
        if rows.size >= 2 * _JUMP_WINDOW:
            yield from _jump(campaign, session, rows, kept[rows], pose[rows], np.array(floors))


def _jump(
    campaign: Campaign, session: str, rows: Indices, terms: FloatArray, pose: FloatArray, floors: FloatArray
) -> Iterator[DataFlag]:
    """Fit a step at every place beside the smooth terms, keep the one that explains most, and judge it robustly."""
    places = np.unique(np.linspace(_JUMP_WINDOW, len(rows) - _JUMP_WINDOW, _JUMP_PLACES).astype(int))
    steps = (np.arange(len(rows))[:, None] >= places).astype(float)
    basis, _ = np.linalg.qr(terms)
    free_steps = steps - basis @ (basis.T @ steps)
    free_pose = (pose - basis @ (basis.T @ pose)) / floors
    power = np.maximum((free_steps**2).sum(axis=0), 1e-9)
    gain = ((free_steps.T @ free_pose) ** 2).sum(axis=1) / power
    best = int(np.argmax(gain))
    place = int(places[best])
    design = np.column_stack([terms, np.arange(len(rows)) >= place])
    fits = [_robust_fit(design, pose[:, k], float(floors[k])) for k in range(pose.shape[1])]
    step = np.array([coefficients[-1] for coefficients, _, _ in fits])
    # What of the step is none of the smooth terms: in rows that were sorted by pose, pose may pass for most of it.
    told = np.sqrt(power[best] / (place * (1.0 - place / len(rows))))
    size = float(told * max(abs(coefficients[-1]) / scale for coefficients, _, scale in fits))
    if size < _JUMP_SIGMAS:
        return
    row, distance, angle = int(rows[place]), float(np.linalg.norm(step[:3])), float(np.linalg.norm(step[3:]))
    large = distance > _LARGE_JUMP_M or angle > _LARGE_JUMP_RAD
    turn = f" and {angle * 1e3:.3g} mrad" if pose.shape[1] > 3 else ""
    yield found(
        campaign,
        FlagCode.MEASUREMENT_JUMP,
        f"from about line {campaign.lines[row]} on all measurements are shifted by {distance * 1e3:.3g} mm{turn} "
        f"(session {session})",
        [row],
        columns.POSITION,
        {"step_mm": distance * 1e3, "step_mrad": angle * 1e3, "deviations": size},
        severity=Severity.WARNING if large else Severity.NOTE,
    )


# --- what is smooth ---


def joint_effect(
    robot: RobotDefinition, drawing: Drawing, drives: FloatArray, frames: OuterFrames
) -> tuple[FloatArray, FloatArray]:
    """Return how the target moves with every drive, then every displacement of every joint, and a small error of each.

    Shapes (n, 6, p), see :func:`target_effect`; and (p,), 1 mm or 1 mrad.
    """
    catalogue = ParameterCatalogue(robot, drawing.mechanism)
    local: tuple[GeometricParameter, ...] = (*catalogue.drives, *catalogue.placements)
    return target_effect(drawing, drives, frames, local), np.array([shown_in(parameter.unit)[1] for parameter in local])


def target_effect(
    drawing: Drawing, drives: FloatArray, frames: OuterFrames, parameters: Sequence[GeometricParameter]
) -> FloatArray:
    """Return how the target on the nominal robot moves with p parameters, (n, 6, p), in tracker axes; NaN without pose.

    Displacement of its origin (m) and rotation vector (rad), per m and rad.
    """
    engine, start = drawing.engine, drawing.starts(drives)
    reached = np.flatnonzero(np.isfinite(start.position).all(axis=1))
    closed = engine.close(drives[reached], start[reached])
    matrix = engine.transfer(closed, parameters).matrix
    effect = np.full((len(drives), *matrix.shape[1:]), np.nan)
    effect[reached] = frames.carried(matrix, PoseStack(closed.position, closed.rotation))
    return effect


def drive_errors(effect: FloatArray, units: Sequence[str], residual: FloatArray, metres_per_rad: float) -> FloatArray:
    """Return the drive errors that would explain residuals best, (n, drives), in m; NaN where the effect is not known.

    Where residuals do not fix all drives, the least such errors are returned.

    Args:
        effect: (n, 6, drives); see :func:`target_effect`.
        units: of the drives, ``m`` or ``rad``. An angle counts as the length it moves the target at the median pose.
        residual: (n, 3) positions, in m, or (n, 6) with rotation vectors, in rad; in base axes.
        metres_per_rad: how rotations weigh against positions, in m.
    """
    reach = np.nanmedian(np.linalg.norm(effect[:, :3], axis=1), axis=0)
    scale = np.where((np.array(units) == "rad") & (reach > 0.0), reach, 1.0)
    count = residual.shape[1]
    weight = np.array([1.0, 1.0, 1.0, *[metres_per_rad] * 3])[:count]
    known = np.isfinite(effect).all(axis=(1, 2))
    inverse = np.linalg.pinv(weight[:, None] * effect[known, :count] / scale, rcond=1e-9)
    errors = np.full((len(effect), len(units)), np.nan)
    errors[known] = np.einsum("nij,nj->ni", inverse, weight * residual[known])
    return errors


def _smooth_terms(campaign: Campaign, poses: PoseStack, *, with_time: bool = True) -> FloatArray:
    """Return the terms a smooth error may have, (n, terms), each scaled to its spread; NaN only where no pose is.

    Constant, linear in pose and conditions, and quadratic in the pose where there are rows enough. The pose is its
    position and what of its rotation varies.
    """
    terms, first = _linear_terms(campaign, poses, with_time)
    pose_terms = terms[1:first]
    squares = [a * b for i, a in enumerate(pose_terms) for b in pose_terms[i:]]
    rows = int(campaign.usable.sum())
    if rows < _ROWS_PER_TERM * len(terms):
        terms = terms[:first] if rows >= _ROWS_PER_TERM * first else terms[:1]
    elif rows >= _ROWS_PER_TERM * (len(terms) + len(squares)):
        terms += squares
    return np.column_stack(terms)


def _linear_terms(campaign: Campaign, poses: PoseStack, with_time: bool) -> tuple[list[FloatArray], int]:
    """Return the constant and linear terms, (n,) each, and how many of them are of the pose alone, which come first."""
    pose_terms = [_scaled(values) for values in (*poses.position_m.T, *_turns(poses).T)]
    kinds = {quantity.name: quantity.kind for quantity in campaign.robot.condition_columns}
    kept = (name for name in campaign.conditions if with_time or kinds[name] not in _SLOW)
    conditions = [campaign.conditions[name] for name in kept]
    conditions += [] if campaign.approach is None else list(campaign.approach.T)
    terms = [np.ones(len(campaign)), *pose_terms]
    for values in conditions:
        if np.unique(values[np.isfinite(values)]).size > 1:
            terms.append(_scaled(np.where(np.isfinite(values), values, np.nanmedian(values))))
    return terms, 1 + len(pose_terms)


def foretelling(campaign: Campaign, poses: PoseStack, rows: Indices) -> FloatArray:
    """Return the variance of what all other rows foretell of some rows (k,), over that of a row, (k,).

    Of a linear error of pose and conditions. Beyond all that the others had it is large: they tell nothing there.
    """
    terms = np.column_stack(_linear_terms(campaign, poses, with_time=True)[0])
    others = np.delete(terms, rows, axis=0)
    others = others[np.isfinite(others).all(axis=1)]
    spread = np.linalg.inv(others.T @ others + _RIDGE * np.eye(terms.shape[1]))
    return np.asarray(np.einsum("ij,jk,ik->i", terms[rows], spread, terms[rows]))


def _turns(poses: PoseStack) -> FloatArray:
    """Return what varies of the rotation matrices, (n, up to 9): cosine and sine where they turn about one axis."""
    rotation = poses.rotation.reshape(-1, 9)
    known = poses.complete
    middle = rotation[known].mean(axis=0)
    _, sizes, axes = np.linalg.svd(rotation[known] - middle, full_matrices=False)
    return np.asarray((rotation - middle) @ axes[sizes > _VARIES * np.sqrt(known.sum())].T)


def _scaled(values: FloatArray) -> FloatArray:
    spread = float(np.nanstd(values))
    centred = values - np.nanmedian(values)
    return centred / spread if spread > 1e-12 else 0.0 * centred


def _unexplained(terms: FloatArray, values: FloatArray, floor: float) -> FloatArray:
    """Return what the terms leave of a column of values, (n,), in robust deviations; see :func:`_leftover`."""
    size, deviation = _leftover(terms, values, floor)
    return size / deviation


def _leftover(terms: FloatArray, values: FloatArray, floor: float) -> tuple[FloatArray, float]:
    """Return what smooth terms (n, t) leave of values, each row judged without itself, and its robust deviation.

    Of NaN rows nothing is left; ``floor`` is the least deviation that counts, in the unit of the values: the noise.
    """
    _, left, scale = _robust_fit(terms, values, floor)
    return _sized(left, scale)


def _sized(left: FloatArray, least: float) -> tuple[FloatArray, float]:
    """Return the sizes of leftovers (n,), 0 for NaN, and their robust deviation, which is no less than given.

    Errors of a crooked robot have long tails: nine rows in ten, not only the middle ones, set the scale; but of those
    that agree, as more than a tenth may be wrong. From the median, which fewer than half cannot move far, the scale
    grows while the rows within its reach say so: over tails, not over a gap to rows that cannot be right.
    """
    size, deviation, before = np.abs(np.nan_to_num(left)), max(least, robust_sigma(left)), 0.0
    while deviation > before and np.isfinite(left).any():
        before, agreeing = deviation, np.abs(left) <= _GAP_SIGMAS * deviation
        deviation = max(before, float(np.quantile(size[agreeing], 0.9)) / _NINETY_PER_CENT)
    return size, deviation


def _filled(terms: FloatArray, values: FloatArray, floor: float) -> FloatArray:
    """Return values (n,) with missing ones replaced by what the terms, fitted to the others, say of them."""
    if np.isfinite(values).all() or not np.isfinite(values).any():
        return values
    coefficients, _, _ = _robust_fit(terms, values, floor)
    return np.where(np.isfinite(values), values, terms @ coefficients)


def _robust_fit(terms: FloatArray, values: FloatArray, floor: float) -> tuple[FloatArray, FloatArray, float]:
    """Return coefficients (terms,), leftover of each row judged without itself (n,), and its deviation."""
    known = np.isfinite(values) & np.isfinite(terms).all(axis=1)
    design, target = terms[known], values[known]
    weight = np.ones(len(design))
    coefficients = np.zeros(design.shape[1])
    left, scale, ridge = target.copy(), max(robust_sigma(target), floor, 1e-12), _RIDGE * np.eye(design.shape[1])
    for step in range(20):
        weighted = design * weight[:, None]
        inverse = np.linalg.inv(weighted.T @ design + ridge)
        leverage = ((design @ inverse) * weighted).sum(axis=1)
        coefficients = inverse @ (weighted.T @ target)
        left = (target - design @ coefficients) / np.clip(1.0 - leverage, 0.2, 1.0)
        scale = max(robust_sigma(left), floor, 1e-12)
        size = np.minimum(np.abs(left) / scale, 1e6)
        # Huber first, which finds the way from anywhere; then Tukey, to which a gross error counts nothing.
        weight = huber_weights(size) if step < 8 else tukey_weights(size)
    full = np.full(values.size, np.nan)
    full[known] = left
    return coefficients, full, scale
