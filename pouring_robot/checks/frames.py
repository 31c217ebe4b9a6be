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
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from pouring_robot.campaign import columns
from pouring_robot.campaign.data import Campaign
from pouring_robot.campaign.nominal import PoseStack, nominal_poses
from pouring_robot.checks.columns import distinct_poses
from pouring_robot.checks.flags import DataFlag, FlagCode, Severity, row_tuple, where
from pouring_robot.estimation.frames import FEWEST_ROWS, FrameFit, affine_map, fit_frames, robust_sigma, rotation_misfit
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
                    self._flag_drive_unit(columns.DRIVES[index], mistake, float(np.median(np.abs(known))), factor)
                    drives[:, index] = values * factor
                    break
        return drives

    def _flag_drive_unit(self, name: str, mistake: str, median: float, factor: float) -> None:
        heading = self.campaign.heading(name)
        unit = "m" if name in columns.LENGTH_DRIVES else "rad"
        self.flags.append(
            DataFlag(
                FlagCode.DRIVE_UNIT,
                Severity.ERROR,
                f"column '{heading}' seems to hold {mistake}: its values come to {median:g} {unit} (median)",
                "correct the unit at the end of the column's name",
                columns=(heading,),
                metrics={f"median_{unit}": median, "factor": factor},
            )
        )

    def _unreachable(self) -> None:
        drives = self.data.drives
        complete = np.isfinite(drives).all(axis=1)
        beyond = np.zeros(len(drives), dtype=bool)
        for index, (low, high) in enumerate(self._limits()):
            beyond |= (drives[:, index] < low - _LIMIT_SLACK) | (drives[:, index] > high + _LIMIT_SLACK)
        rows = np.flatnonzero(complete & (beyond | ~self.data.poses.complete))
        if rows.size:
            self.flags.append(
                DataFlag(
                    FlagCode.UNREACHABLE_DRIVES,
                    Severity.ERROR,
                    f"the robot cannot take the drive values of {where(self.campaign, rows)}",
                    "check the drives' columns and units, and that the model file is this robot's",
                    row_tuple(rows),
                    tuple(self.campaign.heading(name) for name in columns.DRIVES),
                    {"rows": float(rows.size)},
                )
            )

    # --- positions ---

    def _positions(self) -> None:
        sigma = self.campaign.metadata.sigma_position_m or 0.0
        fit = self.data.fit(1.0, rotations=False)
        for _ in range(3):
            if fit.position_scale_m <= max(_SUSPECT_M, _SUSPECT_SIGMAS * sigma):
                break
            best: tuple[float, Comparison, FrameFit, DataFlag] | None = None
            for candidate, flag in self._position_mistakes():
                try:
                    tried = candidate.fit(1.0, rotations=False)
                except FrameFitError:
                    continue
                if tried.position_scale_m < (best[0] if best else _GAIN * fit.position_scale_m):
                    best = tried.position_scale_m, candidate, tried, flag
            if best is None:
                break
            metrics = {"misfit_before_mm": fit.position_scale_m * 1e3, "misfit_after_mm": best[0] * 1e3}
            self.flags.append(dataclasses.replace(best[3], metrics=metrics))
            self.data, fit = best[1], best[2]
        if fit.position_scale_m > _HOPELESS_M:
            self.flags.append(_no_agreement(self.campaign, columns.POSITION, fit.position_scale_m * 1e3, "mm"))
            return
        self.fit = self.data.fit(metres_per_rad(self.campaign))

    def _position_mistakes(self) -> Iterator[tuple[Comparison, DataFlag]]:
        data, heading = self.data, self.campaign.heading
        places = tuple(heading(name) for name in columns.POSITION)
        drives = tuple(heading(name) for name in columns.DRIVES)
        for factor, mistake in _LENGTH_MISTAKES:
            flag = _mistake(
                FlagCode.POSITION_UNIT,
                f"the measured positions seem to hold {mistake}",
                "correct the unit at the end of the columns' names",
                places,
            )
            yield dataclasses.replace(data, position_m=data.position_m * factor), flag
        if not data.inverted:
            flag = _mistake(
                FlagCode.FRAMES_SWAPPED,
                "the measured poses seem to be inverse: the fixed platform seen from the moving one",
                "exchange base and target in the tracker's export, or invert every pose",
                (*places, *(heading(name) for name in columns.ROTATION if data.rotation_vector_rad is not None)),
            )
            yield dataclasses.replace(data, poses=data.poses.inverse(), inverted=True), flag
        flag = _mistake(
            FlagCode.MIRRORED_AXES,
            "the axes of the measured positions are left-handed: one is reversed, or two are exchanged",
            "check order and signs of x, y and z in the tracker's export",
            places,
        )
        complete = data.poses.complete & np.isfinite(data.position_m).all(axis=1)
        affine, spread = affine_map(data.poses, data.position_m, complete)
        if spread > 1e-2 and np.linalg.det(affine) < 0.0:
            yield dataclasses.replace(data, position_m=data.position_m * np.array([-1.0, 1.0, 1.0])), flag
        for factor, mistake in _ANGLE_MISTAKES:
            flag = _mistake(
                FlagCode.DRIVE_UNIT,
                f"column '{drives[3]}' seems to hold {mistake}",
                "correct the unit at the end of the column's name",
                drives[3:],
            )
            yield from self._with_drives(data.drives * np.array([1.0, 1.0, 1.0, factor]), flag)
        for order in itertools.permutations(range(3)):
            if order != (0, 1, 2):
                wrong = ", ".join(f"'{drives[i]}' holds {columns.DRIVES[order[i]]}" for i in range(3) if order[i] != i)
                flag = _mistake(
                    FlagCode.DRIVES_EXCHANGED,
                    f"columns of drives seem to be exchanged: {wrong}",
                    "put the headings over the right columns",
                    tuple(drives[i] for i in range(3) if order[i] != i),
                )
                back = [order.index(i) for i in range(3)]
                yield from self._with_drives(data.drives[:, [*back, 3]], flag)

    def _with_drives(self, drives: FloatArray, flag: DataFlag) -> Iterator[tuple[Comparison, DataFlag]]:
        poses = nominal_poses(self.kinematics, drives)
        if poses.complete.sum() >= max(FEWEST_ROWS, 0.8 * len(drives)):
            poses = poses.inverse() if self.data.inverted else poses
            yield dataclasses.replace(self.data, drives=drives, poses=poses), flag

    # --- rotations ---

    def _rotations(self) -> None:
        vectors = self.data.rotation_vector_rad
        if self.fit is None or vectors is None or np.isfinite(vectors).all(axis=1).sum() < FEWEST_ROWS:
            return
        frames = self.data.fit(1.0, rotations=False)
        sigma = self.campaign.metadata.sigma_rotation_rad or 0.0

        def misfit(candidate: FloatArray) -> float:
            return robust_sigma(rotation_misfit(self.data.poses, rotation_matrices(candidate), frames.frames))

        before = misfit(vectors)
        if before <= max(_SUSPECT_RAD, _SUSPECT_SIGMAS * sigma):
            return
        headings = tuple(self.campaign.heading(name) for name in columns.ROTATION)
        candidates = [
            (misfit(vectors * factor), vectors * factor, flag) for factor, flag in _rotation_mistakes(headings)
        ]
        best = min(candidates, key=lambda candidate: candidate[0])
        if best[0] < _GAIN * before:
            metrics = {"misfit_before_mrad": before * 1e3, "misfit_after_mrad": best[0] * 1e3}
            self.flags.append(dataclasses.replace(best[2], metrics=metrics))
            self.data = dataclasses.replace(self.data, rotation_vector_rad=best[1])
        elif before > _HOPELESS_RAD:
            self.flags.append(_no_agreement(self.campaign, columns.ROTATION, before * 1e3, "mrad"))
            self.data = dataclasses.replace(self.data, rotation_vector_rad=None)
        self.fit = self.data.fit(metres_per_rad(self.campaign))


_LENGTH_MISTAKES = ((1e-3, "millimetres under a heading in metres"), (1e3, "metres under a heading in millimetres"))
_ANGLE_MISTAKES = (
    (math.pi / 180.0, "degrees under a heading in radians"),
    (180.0 / math.pi, "radians under a heading in degrees"),
)


def _rotation_mistakes(headings: tuple[str, ...]) -> Iterator[tuple[float, DataFlag]]:
    for factor, mistake in _ANGLE_MISTAKES:
        yield (
            factor,
            _mistake(
                FlagCode.ROTATION_UNIT,
                f"the measured rotation vectors seem to hold {mistake}",
                "correct the unit at the end of the columns' names",
                headings,
            ),
        )
    yield (
        -1.0,
        _mistake(
            FlagCode.ROTATION_INVERTED,
            "the measured rotation vectors seem to turn the other way: the tracker seen from the target",
            "reverse the signs of rx, ry and rz, or change the tracker's export",
            headings,
        ),
    )


def _mistake(code: FlagCode, message: str, remedy: str, headings: tuple[str, ...]) -> DataFlag:
    return DataFlag(code, Severity.ERROR, message, remedy, columns=headings)


def _no_agreement(campaign: Campaign, names: tuple[str, ...], misfit: float, unit: str) -> DataFlag:
    headings = tuple(campaign.heading(name) for name in names)
    return DataFlag(
        FlagCode.NO_AGREEMENT,
        Severity.ERROR,
        f"drives and measurements do not agree: {', '.join(headings)} miss the nominal robot by {misfit:.3g} {unit}, "
        "whatever the two frames, and no usual mistake of units or frames explains it",
        "check that rows of drives and of measurements belong together, and that the layout is this robot's",
        columns=headings,
        metrics={f"misfit_{unit}": misfit},
    )
