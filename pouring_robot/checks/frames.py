"""Checks against the robot: units, exchanged frames and columns, by the poses that the drives predict.

The nominal robot predicts every measured pose up to the two unknown frames. Where prediction and measurement differ by
more than a robot's errors can explain, each usual mistake is undone in turn; the one that reduces the misfit to a fifth
or less is named, and undone for the checks that follow. Before that, sessions measured from different places are
detected where the campaign does not state them.
"""

import dataclasses
from collections.abc import Callable, Iterable, Iterator, Sequence

import numpy as np

from pouring_robot.campaign import columns
from pouring_robot.campaign.data import Campaign
from pouring_robot.campaign.metadata import PER_SESSION
from pouring_robot.campaign.nominal import PoseStack, nominal_poses
from pouring_robot.checks.columns import distinct_poses
from pouring_robot.checks.flags import DataFlag, FlagCode, Severity, flagged, where
from pouring_robot.checks.units_and_axes import (
    DRIVE_MISTAKES,
    GAIN,
    HOPELESS_M,
    LEFT_HANDED,
    TURN_MISTAKES,
    Comparison,
    Mistake,
    mirror_mistakes,
    position_mistakes,
    reversed_words,
    reversed_x,
)
from pouring_robot.estimation.frames.fit import FrameFit
from pouring_robot.estimation.frames.sessions import in_one_frame
from pouring_robot.estimation.frames.starts import FEWEST_FOR_FRAMES
from pouring_robot.exceptions import CampaignError, FrameFitError
from pouring_robot.io.units import MM, MRAD, joint_shown
from pouring_robot.mechanism.arrays import BoolArray, FloatArray, Indices, evenly_spaced, robust_sigma
from pouring_robot.mechanism.joint_limits import in_limits
from pouring_robot.robot.description.drawing import Drawing

_SUSPECT_M, _SUSPECT_TURN_RAD = 1e-3, 5e-4
"""A robot's errors explain misfits below these; no mistake of units is looked for."""
_HOPELESS_RAD = 0.05  # see HOPELESS_M
_HOPELESS_SHARE = 0.02  # share of the spread of the measured positions: large robots may be off by more
_ROUGH = (
    "nothing is wrong if the robot is that far off, such as a rope-driven wrist; otherwise check the rows and "
    "the drawing"
)
_LIMITS = "if the robot stood there, correct the limits in the URDF; otherwise check the drives' columns and units"
_SUSPECT_SIGMAS = 20.0
_EQUAL = 1.5
_ROUGHLY = 3.0  # times the least rough misfit: twice the _EQUAL that applies once fitted
_TAKEN_UP, _FAR_ROWS = 100.0, 10.0  # how much smaller or larger than the change by a mistake its misfit may be
_TRIED_ROWS = 100  # enough to tell which mistake it is; all rows say whether
_MOST_BEYOND, _SOME_BEYOND = 0.5, 0.05  # share of values beyond the limits
_NEARLY_ALL = 0.9
_LEAST_USED = 0.1  # share of a drive's range; if converted angles move by less, the frames must confirm the unit
_LIMIT_SLACK = 1e-3  # m or rad
_SET_UP_ANEW_M = 0.05  # a set-up that creeps or is bumped moves less
_TIMES_BETTER = 3.0
_OF_THE_DEVICE = (FlagCode.MIRRORED_AXES, FlagCode.FRAMES_SWAPPED)
_TELLING_ROWS = 20  # of a session; with fewer, its own frames, twelve unknowns, explain too much


def in_frames_of_their_own(campaign: Campaign, poses: PoseStack) -> tuple[Campaign, list[DataFlag]]:
    """Return the campaign as seen from one place, and findings about the places of tracker and target by session.

    Different places of the tracker are a finding where the campaign does not state them, and the sessions agree with
    the robot far better from places of their own than from one place.
    """
    if len(set(campaign.sessions)) < 2:
        return campaign, []
    if campaign.metadata.own_frames:
        together = in_one_frame(campaign, poses)
        return together, list(_targets_moved(together, _compared(together, poses)))
    metadata = campaign.metadata.model_copy(update={"frames": PER_SESSION})
    try:  # by positions alone: distances refer to one frame
        together = in_one_frame(dataclasses.replace(campaign, metadata=metadata, distance_m=None), poses)
        aligned = _compared(together, poses)
        apart, shared = _compared(campaign, poses).fit(1.0), aligned.fit(1.0)
    except (CampaignError, FrameFitError):
        return campaign, []  # too few rows to say
    # Each seen from its best place: no place of the tracker explains what remains.
    remounted = list(_targets_moved(together, aligned, shared))
    before, after = apart.position_scale_m, shared.position_scale_m
    moved = float(np.nanmax(np.linalg.norm(together.position_m - campaign.position_m, axis=1)))
    if moved < _SET_UP_ANEW_M or before < _TIMES_BETTER * after:
        return campaign, remounted
    message = (
        f"sessions were measured from places up to {moved:.3g} m apart: seen from one place, they differ from the "
        f"robot by {before / MM:.3g} mm per coordinate; with a frame for each session, by {after / MM:.3g} mm"
    )
    together = dataclasses.replace(together, distance_m=campaign.distance_m)
    return together, [flagged(campaign, FlagCode.APART_SESSIONS, message, metrics={"apart_m": moved}), *remounted]


def _compared(campaign: Campaign, poses: PoseStack) -> Comparison:
    return Comparison(campaign.drives, poses, campaign.position_m, campaign.rotation_vector_rad)


def _targets_moved(campaign: Campaign, everything: Comparison, shared: FrameFit | None = None) -> Iterator[DataFlag]:
    """Yield sessions, seen from one place, that agree with the robot far better with another place of the target.

    All are compared with the drawing; the frames that they share are fitted unless given.
    """
    whole = everything.poses.complete & np.isfinite(campaign.position_m).all(axis=1)
    testable = {name: rows for name, rows in campaign.rows_by_session().items() if whole[rows].sum() >= _TELLING_ROWS}
    if not testable:
        return
    shared = shared or everything.fit(1.0)
    for session, members in testable.items():
        own = everything[members].fit(1.0)
        away = robust_sigma(shared.position_residual_m[members])
        sizes, hopeless = [(away, own.position_scale_m, _SUSPECT_M, MM, "mm")], away > HOPELESS_M
        if shared.rotation_residual_rad is not None and own.rotation_scale_rad is not None:
            turned = robust_sigma(shared.rotation_residual_rad[members])
            sizes.append((turned, own.rotation_scale_rad, _SUSPECT_TURN_RAD, MRAD, "mrad"))
            hopeless = hopeless or turned > _HOPELESS_RAD
        if any(before > max(least, _TIMES_BETTER * after) for before, after, least, _, _ in sizes):
            one = " and ".join(f"{before / si:.3g} {unit}" for before, _, _, si, unit in sizes)
            other = " and ".join(f"{after / si:.3g} {unit}" for _, after, _, si, unit in sizes)
            message = (
                f"in session '{session}' the target seems to sit elsewhere on the robot: with the place of all "
                f"sessions, the rows differ from the robot by {one} per component; with a place of its own, by {other}"
            )
            severity = Severity.ERROR if hopeless else Severity.WARNING
            yield flagged(campaign, FlagCode.TARGET_MOVED, message, members, severity=severity)


class FrameChecks:
    """Finds and undoes mistakes in a campaign's units, frames and columns, by the drawing of its robot."""

    def __init__(self, campaign: Campaign, drawing: Drawing) -> None:
        self.campaign, self.drawing = campaign, drawing
        self.flags: list[DataFlag] = []
        self.fit: FrameFit | None = None
        joints = drawing.mechanism.joint_limits()
        limits = [joints.get(drive.joint, (-np.inf, np.inf)) for drive in campaign.robot.drives]
        self._lower, self._upper = np.transpose(limits)
        drives = self._drive_units(np.array(campaign.drives))
        poses = nominal_poses(drawing, drives)
        self.data = Comparison(drives, poses, campaign.position_m, campaign.rotation_vector_rad)
        # Without different poses the frames are undetermined, and so are findings by them.
        if distinct_poses(campaign) >= FEWEST_FOR_FRAMES:
            try:
                self._positions()
                self._rotations()
            except FrameFitError:
                self._not_compared()
        self._unreachable()

    def _drive_units(self, drives: FloatArray) -> FloatArray:
        """Name and undo wrong units and signs of drives that their limits reveal.

        Where one unit is wrong, others of its kind may be, too.
        """
        share = self._beyond(drives).sum(axis=0) / np.maximum(np.isfinite(drives).sum(axis=0), 1)
        wrong: set[str] = set()
        for index in np.argsort(-share, kind="stable").tolist():
            drive = self.campaign.robot.drives[index]
            kind, zero = drive.command, drive.zero
            if share[index] < (_SOME_BEYOND if kind in wrong else _MOST_BEYOND):
                continue
            low, high, values = self._lower[index], self._upper[index], drives[:, index]
            known = values[np.isfinite(values)] - zero
            if _mostly_within(zero - known, low, high):  # counted the other way
                # Where limits do not determine the sign, or another's values would fit, the frames decide later.
                others = (self.campaign.drives[:, k] for k in np.flatnonzero(share >= _MOST_BEYOND) if k != index)
                if not low < zero < high and not any(_mostly_within(other, low, high) for other in others):
                    words, metrics = reversed_words(self.campaign, drive.column), {"beyond": float(share[index])}
                    self._found(FlagCode.DRIVE_REVERSED, words, [drive.column], metrics)
                    drives[:, index] = 2.0 * zero - values
                continue
            for factor, mistake in DRIVE_MISTAKES[kind]:
                moved = np.ptp(known) * factor if kind == "angle" and known.size >= FEWEST_FOR_FRAMES else 0.0
                if not 0.0 < moved < _LEAST_USED * (high - low) and _mostly_within(known * factor + zero, low, high):
                    median, unit = float(np.median(np.abs(known / drive.factor))), drive.command_unit
                    message = f"column '{self.campaign.heading(drive.column)}' seems to hold {mistake}: its values"
                    message += f" would be {median:g} {unit} (median)"
                    metrics = {f"median_{unit}": median, "factor": factor}
                    self._found(FlagCode.DRIVE_UNIT, message, [drive.column], metrics)
                    drives[:, index] = (values - zero) * factor + zero
                    wrong.add(kind)
                    break
        return drives

    def _found(self, code: FlagCode, message: str, names: Sequence[str], metrics: dict[str, float]) -> None:
        self.flags.append(flagged(self.campaign, code, message, (), names, metrics))

    def _unreachable(self) -> None:
        drives, remedy = self.data.drives, ""
        beyond = self._beyond(drives)
        complete = np.isfinite(drives).all(axis=1)
        rows = np.flatnonzero(complete & (beyond.any(axis=1) | ~self.data.poses.complete))
        if not rows.size:
            return
        message = f"the robot cannot reach the drive values of {where(self.campaign, rows)}"
        names = columns.drive_names(self.campaign.robot)
        if wound := self._whole_turns_beyond(rows):
            names = tuple(self.campaign.robot.drives[k].column for k in wound)
            headings = ", ".join(f"'{self.campaign.heading(name)}'" for name in names)
            several = len(names) > 1
            message += f": there {headings} {'are' if several else 'is'} whole turns beyond the limits of the "
            message += f"joint{'s' * several}, as with encoders that wrap; add or subtract whole turns"
        elif beyond[rows].any(axis=1).all():
            names, far = self._over(rows)
            message += f" (beyond the joint limits: {far})"
            remedy = _LIMITS
        figures, code = {"rows": float(rows.size)}, FlagCode.UNREACHABLE_DRIVES
        self.flags.append(flagged(self.campaign, code, message, rows, names, figures, remedy=remedy))

    def _over(self, rows: Indices) -> tuple[tuple[str, ...], str]:
        """Return the columns of the drives that are beyond their limits in rows (k,), and by how much, in words."""
        values, robot = self.data.drives[rows], self.campaign.robot
        far, names, said = np.fmax(self._lower - values, values - self._upper).max(axis=0), list[str](), list[str]()
        for k in np.flatnonzero(self._beyond(values).any(axis=0)):
            size, unit = joint_shown(float(far[k]), robot.drives[k].unit)
            names.append(robot.drives[k].column)
            said.append(f"'{self.campaign.heading(names[-1])}' by up to {size:.3g} {unit}")
        return tuple(names), ", ".join(said)

    def _whole_turns_beyond(self, rows: Indices) -> list[int]:
        """Return the drives that whole turns would bring within their limits in rows (k,); none if not in all rows."""
        values = self.data.drives[rows]
        turns = np.array([2.0 * np.pi if drive.unit == "rad" else np.inf for drive in self.campaign.robot.drives])
        with np.errstate(invalid="ignore"):  # a slide without limits
            up, down = np.ceil((self._lower - values) / turns), np.floor((self._upper - values) / turns)
        beyond = self._beyond(values)
        if not beyond.any(axis=1).all() or (beyond & (np.isinf(turns) | (up > down))).any():
            return []
        return np.flatnonzero(beyond.any(axis=0)).tolist()

    def _beyond(self, drives: FloatArray) -> BoolArray:
        """Return which drives are beyond their limits, (n, D)."""
        return ~in_limits(drives, self._lower, self._upper, _LIMIT_SLACK)

    def _not_compared(self) -> None:
        """Report that too few rows have a position to fit the frames; rows out of reach are flagged as such.

        Units are checked by the linear map alone.
        """
        measured, turned = self.campaign.position_measured, self.campaign.rotation_measured.any(axis=1)
        whole, turned_only = int(measured.all(axis=1).sum()), np.flatnonzero(turned & ~measured.any(axis=1))
        if whole >= FEWEST_FOR_FRAMES or not (measured.any() or turned.any()):
            return  # distances or closures alone are not meant to be compared
        mistakes = position_mistakes(self.campaign, self.drawing, self.data) if self.data.stretched else ()
        of_units = (one for one in mistakes if one.code in (FlagCode.POSITION_UNIT, FlagCode.DRIVE_UNIT))
        tried = _undone(of_units, self.data[np.flatnonzero(measured.any(axis=1))])
        rigid = sorted((pair for pair in tried if not pair[1].stretched), key=lambda pair: pair[1].stretch)
        possible = [one for one, _ in rigid]
        possible = [one for one in possible if one.of_its_headings(self.campaign)] or possible
        if possible:
            mistake, *others = possible
            mistake = dataclasses.replace(mistake, equals=tuple(one.message for one in others))
            self._found(mistake.code, mistake.in_words, mistake.names, {})
            self.data = mistake.undo(self.data) or self.data
        message = (
            "drives and measurements cannot be compared before a fit, so mistakes in axes, signs or rows are not "
            f"detected: {whole} rows have a complete position, and the two frames need {FEWEST_FOR_FRAMES}"
        )
        severity = Severity.NOTE  # single coordinates are measured on purpose
        if turned_only.size:
            message += f"; there is only a rotation in {where(self.campaign, turned_only)}"
            # Without any length the place of the tracker is unknown.
            severity = Severity.WARNING if measured.any() or self.campaign.distance_m is not None else Severity.ERROR
        figures = {"rows_with_position": float(whole), "rows_with_rotation_only": float(turned_only.size)}
        code, names = FlagCode.NOT_COMPARED, columns.POSITION
        self.flags.append(flagged(self.campaign, code, message, turned_only, names, figures, severity=severity))

    def _no_agreement(self, names: tuple[str, ...], misfit: float, unit: str, *, roughly: bool = False) -> None:
        headings = ", ".join(self.campaign.heading(name) for name in names)
        message = (
            f"drives and measurements {'agree only roughly' if roughly else 'do not agree'}: {headings} differ from "
            f"the nominal robot by {misfit:.3g} {unit}, whatever the two frames, and no usual mistake of units or "
            "frames explains it"
        )
        code, figures = FlagCode.NO_AGREEMENT, {f"misfit_{unit}": misfit}
        severity, remedy = (Severity.WARNING, _ROUGH) if roughly else (Severity.ERROR, "")
        self.flags.append(flagged(self.campaign, code, message, (), names, figures, severity=severity, remedy=remedy))

    def _positions(self) -> None:
        sigma = self.campaign.metadata.sigma_position_m or 0.0
        fit, mirrored = self.data.fit(1.0, rotations=False), None
        for _ in range(3 if np.isfinite(self.data.spread_m) else 0):  # one place determines no unit or axis
            # A mistake in one column of three hardly shows in a robust misfit.
            if fit.position_scale_m <= max(_SUSPECT_M, _SUSPECT_SIGMAS * sigma) and not self.data.stretched:
                break
            before = fit.position_scale_m / self.data.size_m
            mistake = self._likeliest((_EQUAL if self.data.stretched else GAIN) * before)
            if mistake is None or (undone := mistake.undo(self.data)) is None:
                break
            after = undone.fit(1.0, rotations=False)
            gain = _EQUAL if self.data.stretched and not undone.stretched else GAIN
            if after.position_scale_m / undone.size_m > gain * before:
                break
            metrics = {"misfit_before_mm": fit.position_scale_m / MM, "misfit_after_mm": after.position_scale_m / MM}
            self._found(mistake.code, mistake.in_words, mistake.names, metrics)
            mirrored = mistake if mistake.code is FlagCode.MIRRORED_AXES else mirrored
            self.data, fit = undone, after
        if fit.position_scale_m > max(HOPELESS_M, _HOPELESS_SHARE * self.data.spread_m):
            self._no_agreement(columns.POSITION, fit.position_scale_m / MM, "mm")
            return
        if mirrored is not None and self._turns:
            self._which_axes(mirrored)
        alone = self.data.rotation_vector_rad is None
        self.fit = fit if alone else self.data.fit(self.campaign.metadata.metres_per_rad)

    def _which_axes(self, mistake: Mistake) -> None:
        """Name the mirrored axes where rotations determine them: as measured, these fit one mirror image only."""
        mirrored = reversed_x(self.data)
        tried = _undone(mirror_mistakes(self.campaign), mirrored)
        best = _least([one for one in _fitted(tried, _turn_misfit, _HOPELESS_RAD) if one[0] <= _HOPELESS_RAD])
        if best is None or len(best.equals) == len(tried) - 1:
            return  # rotations do not determine it
        named = dataclasses.replace(mistake, message=f"{LEFT_HANDED}: {best.in_words}")
        (k,) = (k for k, flag in enumerate(self.flags) if flag.code is mistake.code)
        headings = tuple(self.campaign.heading(name) for name in best.names)
        self.flags[k] = dataclasses.replace(self.flags[k], message=named.in_words, columns=headings)
        self.data = best.undo(mirrored) or self.data

    @property
    def _turns(self) -> bool:
        """Whether enough rotations were measured to compare them."""
        vectors = self.data.rotation_vector_rad
        return vectors is not None and int(np.isfinite(vectors).all(axis=1).sum()) >= FEWEST_FOR_FRAMES

    def _likeliest(self, most: float) -> Mistake | None:
        """Return the mistake that leaves the least misfit when undone, by some of the rows, with its equals.

        It leaves ``most`` at most, a share of the spread. Of equals, those are dropped that take drives further beyond
        their limits than another.
        """
        complete = np.flatnonzero(self.data.poses.complete & np.isfinite(self.data.position_m).all(axis=1))
        some = self.data[complete[evenly_spaced(complete.size, _TRIED_ROWS)]]
        tried = _undone(position_mistakes(self.campaign, self.drawing, some), some)

        def misfit(data: Comparison, rough: bool) -> float:
            return data.fit(1.0, rotations=False, rough=rough).position_scale_m / data.size_m

        found, put_right = _fitted(tried, misfit, most), dict(tried)
        least = min((after for after, _ in found), default=0.0)
        beyond = {
            m: self._beyond(put_right[m].drives).any(axis=1).mean() for after, m in found if after <= _EQUAL * least
        }
        fewest = min(beyond.values(), default=0.0)
        return _least([one for one in found if beyond.get(one[1], np.inf) <= fewest + _SOME_BEYOND])

    def _rotations(self) -> None:
        vectors = self.data.rotation_vector_rad
        if self.fit is None or vectors is None or not self._turns:
            return
        sigma = self.campaign.metadata.sigma_rotation_rad or 0.0
        before = _turn_misfit(self.data, rough=False)
        if before <= max(_SUSPECT_TURN_RAD, _SUSPECT_SIGMAS * sigma):
            return
        changes = [(m, undone, undone.turned_by(self.data)) for m, undone in _undone(TURN_MISTAKES, self.data)]
        # A mistake that changes vectors by this much may cause the misfit; the frames take up a part of it.
        tried = [(m, undone) for m, undone, far in changes if far / _TAKEN_UP < before < far * _FAR_ROWS]
        # Rotations by errors alone are smaller in any smaller unit; but no vector is longer than a whole turn.
        whole = float(np.nanmedian(np.linalg.norm(vectors, axis=1))) > 2.0 * np.pi
        most = GAIN * (before if whole else min(before, self.data.turned_rad))
        misfits = _fitted(tried, _turn_misfit, most)
        least = min((after for after, _ in misfits), default=before)
        # Of equals the first: the simpler mistake.
        after, best = next((one for one in misfits if one[0] <= _EQUAL * least), (before, TURN_MISTAKES[0]))
        if after < most:
            metrics = {"misfit_before_mrad": before / MRAD, "misfit_after_mrad": after / MRAD}
            self._found(best.code, best.message, best.names, metrics)
            self.data = dict(tried)[best]
        elif before > _HOPELESS_RAD:
            # A wrist whose ropes yield is off by degrees, and still follows its commands.
            follows = before < GAIN * self.data.turned_rad
            self._no_agreement(columns.ROTATION, before / MRAD, "mrad", roughly=follows)
            self.data = self.data if follows else dataclasses.replace(self.data, rotation_vector_rad=None)
        self.fit = self.data.fit(self.campaign.metadata.metres_per_rad)


def _mostly_within(values: FloatArray, low: float, high: float) -> bool:
    known = values[np.isfinite(values)]
    return bool(known.size) and bool(np.mean((known >= low) & (known <= high)) > _NEARLY_ALL)


def _undone(mistakes: Iterable[Mistake], data: Comparison) -> list[tuple[Mistake, Comparison]]:
    """Return the mistakes that can be undone in data, each with the data without it."""
    return [(mistake, undone) for mistake in mistakes if (undone := mistake.undo(data)) is not None]


def _least(misfits: list[tuple[float, Mistake]]) -> Mistake | None:
    """Return the mistake that leaves the least misfit, with its equals; None if there is none."""
    if not misfits:
        return None
    equal = _EQUAL * min(misfit for misfit, _ in misfits)
    # Of equals, mistakes of the device come last: a slide that is counted from its other end is more usual.
    in_order = sorted(misfits, key=lambda one: (one[0] > equal, one[1].code in _OF_THE_DEVICE, one[0]))
    (_, best), *others = in_order
    equals = (mistake.message for misfit, mistake in others if misfit < equal)
    return dataclasses.replace(best, equals=tuple(equals))


def _fitted(
    tried: list[tuple[Mistake, Comparison]], misfit: Callable[[Comparison, bool], float], most: float
) -> list[tuple[float, Mistake]]:
    """Return the misfit with each mistake undone, of those that may be the least or its equal, and at most ``most``.

    ``misfit`` takes the data, and whether a rough fit is enough.
    """
    rough = [misfit(data, True) for _, data in tried]
    enough = _ROUGHLY * min([most, *rough])
    return [
        (misfit(data, False), mistake) for (mistake, data), about in zip(tried, rough, strict=True) if about <= enough
    ]


def _turn_misfit(data: Comparison, rough: bool) -> float:
    """Return the misfit of rotations after fitting the frames, in rad, or that of positions if it is worse."""
    # Rotations of the wrong sense could be fitted at the cost of positions.
    fit = data.fit(HOPELESS_M / _HOPELESS_RAD, rough=rough)
    return max(fit.rotation_scale_rad or 0.0, fit.position_scale_m * _HOPELESS_RAD / HOPELESS_M)
