"""Checks against the robot: units, exchanged frames and columns, by what the drives say the poses should be.

The nominal robot predicts every measured pose up to the two unknown frames. Where prediction and measurement differ by
more than errors of a robot can, each usual mistake is undone in turn; the one that brings the misfit down to
a fifth or less is named, and undone for the checks that follow.
"""

from __future__ import annotations

import contextlib
import dataclasses
import itertools
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from pouring_robot.campaign import columns
from pouring_robot.campaign.data import Campaign
from pouring_robot.campaign.nominal import PoseStack, nominal_poses
from pouring_robot.checks.columns import distinct_poses
from pouring_robot.checks.flags import DataFlag, FlagCode, found, where
from pouring_robot.estimation.frame_fit import FrameFit, fit_frames
from pouring_robot.estimation.frame_starts import FEWEST_ROWS, affine_map
from pouring_robot.exceptions import FrameFitError
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.rotations import rotation_matrices
from pouring_robot.robot.pouring.kinematics import FourUPUKinematics
from pouring_robot.robot.pouring.names import DRIVE_JOINTS

_SUSPECT_M, _SUSPECT_RAD = 1e-3, 5e-3
"""Misfits below these a robot's errors explain; no mistake of units is looked for."""
_HOPELESS_M, _HOPELESS_RAD = 0.02, 0.05
"""Misfits above these no robot's errors explain."""
_SUSPECT_SIGMAS = 20.0
_GAIN = 0.2
_DEFAULT_METRES_PER_RAD = 1.0
_LIMIT_SLACK = 1e-3  # m or rad


@dataclass(frozen=True, eq=False)
class Comparison:
    """Commands and measurements side by side, as far as the mistakes found are undone.

    Attributes:
        drives: (n, 4) in m and rad.
        poses: nominal poses for them; NaN where there are none.
        position_m: (n, 3) measured positions, in m.
        rotation_vector_rad: (n, 3) measured rotation vectors, in rad, or None.
        inverted: whether the measured poses are those of the tracker's side seen from the platform's.
    """

    drives: FloatArray
    poses: PoseStack
    position_m: FloatArray
    rotation_vector_rad: FloatArray | None
    inverted: bool = False

    def fit(self, metres_per_rad: float, *, rotations: bool = True) -> FrameFit:
        """Fit the two frames; see :func:`fit_frames`."""
        with_rotations = rotations and self.rotation_vector_rad is not None
        rotation = rotation_matrices(self.rotation_vector_rad) if with_rotations else None  # type: ignore[arg-type]
        return fit_frames(self.poses, self.position_m, rotation, metres_per_rad)


@dataclass(frozen=True, eq=False)
class Mistake:
    """A usual mistake as it would be told, the quantities it is about, and the data with it undone."""

    code: FlagCode
    message: str
    names: Sequence[str]
    undone: Comparison


def metres_per_rad(campaign: Campaign) -> float:
    """Return noise of a coordinate over noise of a rotation component, in m; 1 m where the file states neither."""
    position, rotation = campaign.metadata.sigma_position_m, campaign.metadata.sigma_rotation_rad
    return position / rotation if position and rotation else _DEFAULT_METRES_PER_RAD


class FrameChecks:
    """Finds and undoes mistakes of units, frames and columns.

    Args:
        campaign: the data.
        kinematics: nominal kinematics of the robot.
    """

    def __init__(self, campaign: Campaign, kinematics: FourUPUKinematics) -> None:
        """Start from the data as they are."""
        self.campaign, self.kinematics = campaign, kinematics
        self.flags: list[DataFlag] = []
        self.fit: FrameFit | None = None
        drives = self._drive_units(np.array(campaign.drives))
        self.data = Comparison(
            drives, nominal_poses(kinematics, drives), campaign.position_m, campaign.rotation_vector_rad
        )
        # Without different poses the frames are anything, and so is what they say of the data.
        if distinct_poses(campaign) >= FEWEST_ROWS:
            with contextlib.suppress(FrameFitError):  # too few rows within reach, which are flagged
                self._positions()
                self._rotations()
        self._unreachable()

    def _limits(self) -> list[tuple[float, float]]:
        limits = self.kinematics.mechanism.joint_limits()
        return [limits[name] for name in DRIVE_JOINTS]

    def _drive_units(self, drives: FloatArray) -> FloatArray:
        """Name and undo units of drives that their limits give away."""
        for index, (low, high) in enumerate(self._limits()):
            values = drives[:, index]
            known = values[np.isfinite(values)]
            if known.size == 0 or np.mean((known < low) | (known > high)) < 0.5:
                continue
            for factor, mistake in _LENGTH_MISTAKES if index < 3 else _ANGLE_MISTAKES:
                if np.mean((known * factor >= low) & (known * factor <= high)) > 0.9:
                    self._flag_drive_unit(
                        self.campaign.robot.drives[index].column, mistake, float(np.median(np.abs(known))), factor
                    )
                    drives[:, index] = values * factor
                    break
        return drives

    def _flag_drive_unit(self, name: str, mistake: str, median: float, factor: float) -> None:
        unit = next(drive.unit for drive in self.campaign.robot.drives if drive.column == name)
        heading = self.campaign.heading(name)
        message = f"column '{heading}' seems to hold {mistake}: its values come to {median:g} {unit} (median)"
        self._found(FlagCode.DRIVE_UNIT, message, [name], {f"median_{unit}": median, "factor": factor})

    def _found(
        self, code: FlagCode, message: str, names: Sequence[str], metrics: dict[str, float], rows: Iterable[int] = ()
    ) -> None:
        self.flags.append(found(self.campaign, code, message, rows, names, metrics))

    def _unreachable(self) -> None:
        drives = self.data.drives
        complete = np.isfinite(drives).all(axis=1)
        beyond = np.zeros(len(drives), dtype=bool)
        for index, (low, high) in enumerate(self._limits()):
            beyond |= (drives[:, index] < low - _LIMIT_SLACK) | (drives[:, index] > high + _LIMIT_SLACK)
        rows = np.flatnonzero(complete & (beyond | ~self.data.poses.complete))
        if rows.size:
            message = f"the robot cannot take the drive values of {where(self.campaign, rows)}"
            self._found(
                FlagCode.UNREACHABLE_DRIVES,
                message,
                columns.drive_names(self.campaign.robot),
                {"rows": float(rows.size)},
                rows,
            )

    def _no_agreement(self, names: tuple[str, ...], misfit: float, unit: str) -> None:
        headings = ", ".join(self.campaign.heading(name) for name in names)
        message = (
            f"drives and measurements do not agree: {headings} miss the nominal robot by {misfit:.3g} {unit}, "
            "whatever the two frames, and no usual mistake of units or frames explains it"
        )
        self._found(FlagCode.NO_AGREEMENT, message, names, {f"misfit_{unit}": misfit})

    # --- positions ---

    def _positions(self) -> None:
        sigma = self.campaign.metadata.sigma_position_m or 0.0
        fit = self.data.fit(1.0, rotations=False)
        for _ in range(3):
            if fit.position_scale_m <= max(_SUSPECT_M, _SUSPECT_SIGMAS * sigma):
                break
            best: tuple[float, FrameFit, Mistake] | None = None
            for mistake in self._position_mistakes():
                try:
                    tried = mistake.undone.fit(1.0, rotations=False)
                except FrameFitError:
                    continue
                if tried.position_scale_m < (best[0] if best else _GAIN * fit.position_scale_m):
                    best = tried.position_scale_m, tried, mistake
            if best is None:
                break
            metrics = {"misfit_before_mm": fit.position_scale_m * 1e3, "misfit_after_mm": best[0] * 1e3}
            _, fit, mistake = best
            self._found(mistake.code, mistake.message, mistake.names, metrics)
            self.data = mistake.undone
        if fit.position_scale_m > _HOPELESS_M:
            self._no_agreement(columns.POSITION, fit.position_scale_m * 1e3, "mm")
            return
        self.fit = self.data.fit(metres_per_rad(self.campaign))

    def _position_mistakes(self) -> Iterator[Mistake]:
        data = self.data
        names_of = columns.drive_names(self.campaign.robot)
        drives = [self.campaign.heading(name) for name in names_of]
        for factor, wrong in _LENGTH_MISTAKES:
            undone = dataclasses.replace(data, position_m=data.position_m * factor)
            message = f"the measured positions seem to hold {wrong}"
            yield Mistake(FlagCode.POSITION_UNIT, message, columns.POSITION, undone)
        if not data.inverted:
            undone = dataclasses.replace(data, poses=data.poses.inverse(), inverted=True)
            message = "the measured poses seem to be inverse: the fixed platform seen from the moving one"
            turned = columns.ROTATION if data.rotation_vector_rad is not None else ()
            yield Mistake(FlagCode.FRAMES_SWAPPED, message, (*columns.POSITION, *turned), undone)
        complete = data.poses.complete & np.isfinite(data.position_m).all(axis=1)
        affine, spread = affine_map(data.poses, data.position_m, complete)
        if spread > 1e-2 and np.linalg.det(affine) < 0.0:
            undone = dataclasses.replace(data, position_m=data.position_m * np.array([-1.0, 1.0, 1.0]))
            message = "the axes of the measured positions are left-handed: one is reversed, or two are exchanged"
            yield Mistake(FlagCode.MIRRORED_AXES, message, columns.POSITION, undone)
        for factor, wrong in _ANGLE_MISTAKES:
            message = f"column '{drives[3]}' seems to hold {wrong}"
            scaled = data.drives * np.array([1.0, 1.0, 1.0, factor])
            yield from self._with_drives(scaled, FlagCode.DRIVE_UNIT, message, names_of[3:])
        for order in itertools.permutations(range(3)):
            moved = [i for i in range(3) if order[i] != i]
            if moved:
                wrong = ", ".join(f"'{drives[i]}' holds {names_of[order[i]]}" for i in moved)
                message, names = f"columns of drives seem to be exchanged: {wrong}", [names_of[i] for i in moved]
                back = data.drives[:, [*np.argsort(order), 3]]
                yield from self._with_drives(back, FlagCode.DRIVES_EXCHANGED, message, names)

    def _with_drives(self, drives: FloatArray, code: FlagCode, message: str, names: Sequence[str]) -> Iterator[Mistake]:
        poses = nominal_poses(self.kinematics, drives)
        if poses.complete.sum() >= max(FEWEST_ROWS, 0.8 * len(drives)):
            poses = poses.inverse() if self.data.inverted else poses
            yield Mistake(code, message, names, dataclasses.replace(self.data, drives=drives, poses=poses))

    # --- rotations ---

    def _rotations(self) -> None:
        vectors = self.data.rotation_vector_rad
        if self.fit is None or vectors is None or np.isfinite(vectors).all(axis=1).sum() < FEWEST_ROWS:
            return
        sigma = self.campaign.metadata.sigma_rotation_rad or 0.0

        def misfit(factor: float) -> float:
            # Rotations of the wrong sense could be fitted at the cost of positions.
            fit = dataclasses.replace(self.data, rotation_vector_rad=vectors * factor).fit(_HOPELESS_M / _HOPELESS_RAD)
            return max(fit.rotation_scale_rad or 0.0, fit.position_scale_m * _HOPELESS_RAD / _HOPELESS_M)

        before = misfit(1.0)
        if before <= max(_SUSPECT_RAD, _SUSPECT_SIGMAS * sigma):
            return
        after, factor, code, wrong = min(
            (misfit(factor), factor, code, wrong) for factor, code, wrong in _TURN_MISTAKES
        )
        if after < _GAIN * before:
            metrics = {"misfit_before_mrad": before * 1e3, "misfit_after_mrad": after * 1e3}
            self._found(code, f"the measured rotation vectors seem to {wrong}", columns.ROTATION, metrics)
            self.data = dataclasses.replace(self.data, rotation_vector_rad=vectors * factor)
        elif before > _HOPELESS_RAD:
            self._no_agreement(columns.ROTATION, before * 1e3, "mrad")
            self.data = dataclasses.replace(self.data, rotation_vector_rad=None)
        self.fit = self.data.fit(metres_per_rad(self.campaign))


_LENGTH_MISTAKES = ((1e-3, "millimetres under a heading in metres"), (1e3, "metres under a heading in millimetres"))
_ANGLE_MISTAKES = (
    (math.pi / 180.0, "degrees under a heading in radians"),
    (180.0 / math.pi, "radians under a heading in degrees"),
)
_TURN_MISTAKES = (
    *((factor, FlagCode.ROTATION_UNIT, f"hold {wrong}") for factor, wrong in _ANGLE_MISTAKES),
    (-1.0, FlagCode.ROTATION_INVERTED, "turn the other way: the tracker seen from the target"),
)
