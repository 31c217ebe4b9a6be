"""Whether the stated noise can be true, and whether drives were rounded: by scatter that no smooth cause explains.

Let r be the residuals of one measured component, in n rows, of the nominal robot with both frames fitted. The model is

    r ~ N(0, σ² (f² I + t² Z Zᵀ)),  frames free,

where Z has a column for all that may move the target smoothly, 1 mm or 1 mrad each over σ: every displacement of every
joint, every drive, base and drives with every condition, session, side of approach and linear or quadratic term of the
position, and drives under weight. The rest is the noise, f σ. f and t are found by maximum likelihood, and f = 1 is
tested by the likelihood ratio. The test is repeated with more causes: drives that err in proportion to the values of
all drives, drives that err in proportion to their own value and by waves of their turn, and shifts of all joints with
every temperature, as on links that grow.
"""

import functools
import itertools
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg
import scipy.optimize
from scipy.special import chdtri

from pouring_robot.batch import seen_from_rest
from pouring_robot.campaign import columns
from pouring_robot.campaign.data import Campaign
from pouring_robot.checks.flags import DataFlag, FlagCode, flagged
from pouring_robot.checks.smooth_errors import Aligned, condition_terms
from pouring_robot.estimation.noise import FALSE_ALARMS, LEAST_FACTOR
from pouring_robot.io.figures import two_digits
from pouring_robot.io.units import DEG, MM, MRAD, shown_in
from pouring_robot.mechanism.arrays import FloatArray, Indices, evenly_spaced
from pouring_robot.mechanism.local_parameters import drive_parameters
from pouring_robot.mechanism.weight_on_joints import force_per_newton, own_force, up_in_base
from pouring_robot.robot.description.drawing import Drawing

_MOST_ROWS, _FEWEST_ROWS = 200, 20
_ROUND_OFF = 1e-6  # N and Nm
_ORDERS = 8  # of waves of a turn, as of encoders, gears and screws; their amplitude falls with the order
_STILL_M = 1e-9  # positions that vary by less are constant
_ROUNDED = 1e-3  # share of a step by which values may miss its multiples


@dataclass(frozen=True, eq=False)
class Scatter:
    """Scatter of a measured component of n rows, computed on demand: one component that scatters little suffices."""

    residual: FloatArray  # over the stated noise, (n,)
    free: FloatArray  # derivatives by the frames, (n, 12)
    causes: FloatArray  # smooth causes, over the noise, (n, c)
    by_drives: FloatArray  # variance that one unit of white error of every drive would add, over that of the noise

    @functools.cached_property
    def _spectrum(self) -> tuple[FloatArray, FloatArray]:
        """Variance of the causes and square of the residuals in each direction that the frames leave free."""
        outside = scipy.linalg.null_space((self.free / np.maximum(np.linalg.norm(self.free, axis=0), 1e-300)).T)
        moved = outside.T @ self.causes
        power, directions = np.linalg.eigh(moved @ moved.T)
        return np.maximum(power, 0.0), (directions.T @ (outside.T @ self.residual)) ** 2

    def _cost(self, logs: Sequence[float]) -> tuple[float, FloatArray]:
        """Return -log likelihood and its derivatives by the logarithms of both standard deviations."""
        power, squares = self._spectrum
        own, caused = math.exp(2.0 * logs[0]), math.exp(2.0 * logs[1]) * power
        variance = own + caused
        slope = (1.0 - squares / variance) / variance
        return float(0.5 * np.sum(np.log(variance) + squares / variance)), np.array([own * slope.sum(), caused @ slope])

    @functools.cached_property
    def _best(self) -> tuple[float, float]:
        """The least cost and log f there."""
        bounds = [(-12.0, 12.0), (-15.0, 6.0)]

        def best(start: float) -> tuple[float, float]:
            least = scipy.optimize.minimize(self._cost, (start, -2.0), jac=True, method="L-BFGS-B", bounds=bounds)
            return float(least.fun), float(least.x[0])

        return min(best(start) for start in (0.0, 2.0, 4.0, 6.0))

    @property
    def factor(self) -> float:
        """f, over the stated noise."""
        return math.exp(self._best[1])

    @property
    def too_small(self) -> bool:
        """Whether the stated noise is too small, by more than a data sheet may err and chance explains."""
        if self.factor <= LEAST_FACTOR:
            return False
        stated = scipy.optimize.minimize_scalar(
            lambda log: self._cost((0.0, log))[0], bounds=(-15.0, 6.0), method="bounded"
        )
        return 2.0 * (float(stated.fun) - self._best[0]) > float(chdtri(1, 2.0 * FALSE_ALARMS))


def check_noise(aligned: Aligned, wrong: Indices) -> Iterator[DataFlag]:
    """Yield rounded drives or too small a noise, given the rows to leave out."""
    campaign, data = aligned.campaign, aligned.data
    sound = data.poses.complete & campaign.usable & np.isfinite(data.position_m).all(axis=1)
    sound[wrong] = False
    rows = np.flatnonzero(sound)
    # Separate frames of each session were fitted to these rows, and are not among the causes below.
    apart = campaign.metadata.own_frames
    if rows.size < _FEWEST_ROWS or data.inverted or apart or not campaign.metadata.sigma_position_m:
        return
    rows = rows[evenly_spaced(rows.size, _MOST_ROWS)]
    effect = aligned.joint_effect(rows)
    scatters = _scatters(aligned, rows, effect)
    if not scatters:
        return
    rounded = list(_rounded(campaign, scatters))
    yield from rounded
    if rounded or not all(one.too_small for one in scatters):
        return
    # Effects of weight need a closure a row, and waves are many: they are computed only where they may explain scatter.
    by_drive = list(_by_weight(campaign, aligned.drawing, data.drives[rows], rows))
    scatters = _scatters(aligned, rows, effect, by_drive)
    if not all(one.too_small for one in scatters):
        return
    # With few rows each of these explains a part of any noise: it may acquit the noise, but the others estimate it.
    warm = (np.tile(values, (len(effect[1]), 1)).T for values in _conditions(campaign, rows, "temperature"))
    moved = _in_proportion(data.drives[rows])
    along = (np.roll(moved, shift, axis=1) for shift in range(moved.shape[1]))  # each with each, itself among them
    more = (along, _by_own_place(campaign, data.drives[rows]), warm)
    tried = (_scatters(aligned, rows, effect, (*by_drive, *causes)) for causes in more)
    if all(one.too_small for group in tried for one in group):
        factor = min(one.factor for one in scatters)
        stated = campaign.metadata.sigma_position_m / MM
        message = (
            f"the stated noise is too small, or the errors differ from move to move: all {len(scatters)} measured "
            f"components scatter at least {factor:.{two_digits(factor)}f} times as much, which no smooth cause "
            f"explains; for a position, that is {factor * stated:.2g} mm, not {stated:.2g}"
        )
        yield flagged(campaign, FlagCode.NOISE_TOO_SMALL, message, metrics={"factor": factor})


def _scatters(
    aligned: Aligned, rows: Indices, effect: tuple[FloatArray, FloatArray], more: Iterable[FloatArray] = ()
) -> list[Scatter]:
    """Return the scatter of each component of some rows.

    ``effect`` is that of every joint, see :meth:`Aligned.joint_effect`; ``more`` are more causes, (n, D) or (n, p)
    each: errors row by row of every drive, or of every parameter of the effect.
    """
    campaign, data, (moved, units) = aligned.campaign, aligned.data, effect
    frames = aligned.fit.frames.jacobian(data.poses[rows])
    drives = moved[:, :, : len(campaign.robot.drives)]
    yielding = drives * units[: drives.shape[2]]
    by_condition = np.concatenate([frames[:, :, :6] * ([MM] * 3 + [MRAD] * 3), yielding], axis=2)
    varying = (*_conditions(campaign, rows), *_sessions(campaign, rows), *_bends(data.poses.position_m[rows]))
    smooth = [moved * units, *(by_condition * values[:, None, None] for values in varying)]
    if campaign.approach is not None:
        smooth += [by_condition * side[:, None, None] for side in np.nan_to_num(campaign.approach[rows]).T]
    smooth += [(moved * units)[:, :, : sizes.shape[1]] * sizes[:, None] for sizes in more]
    causes = np.concatenate(smooth, axis=2)
    sigmas = np.repeat([campaign.metadata.sigma_position_m or 0.0, campaign.metadata.sigma_rotation_rad or 0.0], 3)
    scatters = []
    for c, r in enumerate(np.hstack([residual[rows] for residual, _ in aligned.residuals]).T):
        kept, sigma = np.isfinite(r) & np.isfinite(causes[:, c]).all(axis=1), float(sigmas[c])
        if sigma and kept.sum() >= _FEWEST_ROWS:
            white = np.mean((drives[kept, c] / sigma) ** 2, axis=0)
            scatters.append(Scatter(r[kept] / sigma, frames[kept, c], causes[kept, c] / sigma, white))
    return scatters


def _by_weight(campaign: Campaign, drawing: Drawing, drives: FloatArray, rows: Indices) -> Iterator[FloatArray]:
    """Yield forces of weight on drives, (n, D), over the largest on each: of the links, of a load, of its change."""
    robot, engine = campaign.robot, drawing.engine
    closed, mechanism = engine.close(drives, drawing.starts(drives)), engine.structure.mechanism
    ladle = None if robot.own_weight else campaign.metadata.ladle_centre_of_mass_m  # then it is among the links
    place = ladle or mechanism.placement_on_end(robot.payload_frame).translation
    rest, lifted = seen_from_rest(engine, closed)
    moved = rest.transfer(lifted, drive_parameters(mechanism)).matrix
    share = force_per_newton(up_in_base(rest.structure.mechanism), moved, lifted.rotation, place)
    forces = [own_force(mechanism, engine.structure.configurations(closed.joints)), share]
    loads = campaign.conditions.get("payload")
    if loads is not None and np.isfinite(loads[rows]).any():
        forces.append(share * np.where(np.isfinite(loads[rows]), loads[rows], np.nanmedian(loads[rows]))[:, None])
    for force in forces:
        # Where weight exerts no force, round-off must not be magnified: it would pass for noise.
        yield force / np.maximum(np.abs(force).max(axis=0), _ROUND_OFF)


def _in_proportion(drives: FloatArray) -> FloatArray:
    moved = drives - drives.mean(axis=0)
    return np.asarray(moved / np.maximum(np.abs(moved).max(axis=0), _STILL_M))


def _by_own_place(campaign: Campaign, drives: FloatArray) -> Iterator[FloatArray]:
    """Yield functions of each drive's own value, (n, D): proportional, and waves of a turn of joint or motor."""
    yield _in_proportion(drives)
    own = zip(campaign.robot.drives, drives.T, strict=True)
    turned = np.transpose([drive.turned(values, campaign.metadata.screw_pitch_m) for drive, values in own])
    for order in range(1, _ORDERS + 1):
        yield from (np.cos(order * turned) / order, np.sin(order * turned) / order)


def _bends(position_m: FloatArray) -> Iterator[FloatArray]:
    """Yield linear and quadratic terms of positions (n, 3), (n,) each, as of guides that bow."""
    spread = np.ptp(position_m, axis=0)
    varied = spread > _STILL_M  # else round-off would be magnified
    x = 2.0 * (position_m - position_m.mean(axis=0))[:, varied] / spread[varied]
    yield from x.T
    yield from (x[:, i] * x[:, k] for i, k in itertools.combinations_with_replacement(range(x.shape[1]), 2))


def _conditions(campaign: Campaign, rows: Indices, kind: str = "") -> Iterator[FloatArray]:
    """Yield conditions, of one kind or all, as :func:`condition_terms`."""
    kind_of = {quantity.name: quantity.kind for quantity in campaign.robot.condition_columns}
    kept = (values[rows] for name, values in campaign.conditions.items() if kind in ("", kind_of[name]))
    yield from condition_terms(kept)


def _sessions(campaign: Campaign, rows: Indices) -> Iterator[FloatArray]:
    """Yield an indicator of each session but the first, 1 in its rows."""
    for session in list(campaign.rows_by_session().values())[1:]:
        yield np.isin(rows, session).astype(float)


def _rounded(campaign: Campaign, scatters: Sequence[Scatter]) -> Iterator[DataFlag]:
    """Yield drives that are commanded in steps, if the scatter is that of errors of half a step."""
    names, factors = columns.drive_names(campaign.robot), np.array([drive.factor for drive in campaign.robot.drives])
    given = zip(campaign.drives[campaign.usable].T, campaign.robot.drives, strict=True)
    steps = [_step(drive.commanded(values), drive.command_unit) for values, drive in given]
    for step, said in dict.fromkeys(one for one in steps if one[0] > 0.0):
        drives = np.array([k for k, one in enumerate(steps) if one == (step, said)])
        variances = [step**2 / 12.0 * float(factors[drives] ** 2 @ one.by_drives[drives]) for one in scatters]
        c = int(np.argmax(variances))
        if variances[c] > LEAST_FACTOR**2 and scatters[c].factor ** 2 > 1.0 + 0.5 * variances[c]:
            unit, si = shown_in(campaign.robot.drives[drives[0]].command_unit)
            headings = ", ".join(f"'{campaign.heading(names[k])}'" for k in drives)
            share = math.sqrt(variances[c])
            message = (
                f"{headings} rounded to {said}: that alone is {share:.{two_digits(share)}f} times the stated noise, "
                "and the measurements scatter accordingly"
            )
            figures = {f"step_{unit}": step / si}
            yield flagged(campaign, FlagCode.ROUNDED_DRIVES, message, (), [names[k] for k in drives], figures)


def _step(values: FloatArray, unit: str) -> tuple[float, str]:
    """Return the largest step that all values are multiples of, in m or rad, and in words; 0: none is."""
    shown, si = shown_in(unit)
    steps = [(_round_step(values) / si, shown, si)]
    if unit == "rad":
        steps.append((_round_step(np.degrees(values)), "deg", DEG))
    step, shown, si = max(steps, key=lambda one: one[0] * one[2])
    return step * si, f"{step:g} {shown}"


def _round_step(values: FloatArray) -> float:
    """Return the largest step of 1, 2 or 5 times a power of ten that all values are multiples of; 0: none is."""
    known = values[np.isfinite(values)]
    for power in range(0, -7, -1):
        for size in (5.0, 2.0, 1.0):
            step = size * 10.0**power
            steps = known / step
            if known.size and np.ptp(known) > 2.0 * step and np.all(np.abs(steps - np.round(steps)) < _ROUNDED):
                return step
    return 0.0
