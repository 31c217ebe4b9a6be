"""What moved: single parameters, and the combinations of them that a campaign determines."""

import dataclasses

import numpy as np

from pouring_robot.calibration.findings import CalibrationFindings
from pouring_robot.estimation.frames.outer import FRAMES
from pouring_robot.estimation.frames.sessions import SESSION
from pouring_robot.estimation.identifiability import combination_text, robot_combinations
from pouring_robot.estimation.instruments import are
from pouring_robot.mechanism.arrays import rms
from pouring_robot.mechanism.poses import MM, MRAD

Z95 = 1.959963984540054
"""Half the 95 % interval of a normal deviate."""
LEARNT = 0.5
"""A parameter is measured when the data took at least this share of its prior variance away."""

SEEN = 0.01
"""Below this share no pose of the campaign shows a parameter by itself."""


@dataclasses.dataclass(frozen=True)
class Movement:
    """A number that was found, in its unit, mm or mrad, on top of the present model.

    It is a parameter, or a combination that the campaign determines, the frames left out.
    """

    name: str
    unit: str
    value: float
    std: float
    prior_std: float

    @property
    def interval(self) -> tuple[float, float]:
        """The 95 % interval."""
        return self.value - Z95 * self.std, self.value + Z95 * self.std

    @property
    def moved(self) -> bool:
        """Whether the 95 % interval leaves out zero."""
        return abs(self.value) > Z95 * self.std

    @property
    def surprise(self) -> float:
        """How many standard deviations it is off."""
        return abs(self.value) / self.std


@dataclasses.dataclass(frozen=True)
class ParameterLine(Movement):
    """One parameter: the group it was kept with, and the share of its prior variance that the data took away."""

    group: str
    learnt: float

    @property
    def verdict(self) -> str:
        """What to make of it, in words."""
        if self.learnt < LEARNT:
            return "held by its tolerance"
        return "moved" if self.moved else "measured, not off"


def _shown(unit: str) -> tuple[str, float]:
    return ("mm", MM) if unit == "m" else ("mrad", MRAD)


def parameter_lines(calibration: CalibrationFindings) -> list[ParameterLine]:
    """Return the parameters kept, in order."""
    fit, std = calibration.fit, calibration.std
    names = [(group.name, p) for group in calibration.selection.groups for p in group.parameters]
    lines = []
    for k, (group, parameter) in enumerate(names, start=FRAMES):
        unit, factor = _shown(parameter.unit)
        value, error, prior = (float(v[k]) / factor for v in (fit.unknowns.values, std, fit.prior_std))
        lines.append(ParameterLine(parameter.name, unit, value, error, prior, group, float(fit.learnt[k])))
    return lines


@dataclasses.dataclass(frozen=True)
class GroupLine:
    """What one group of parameters does to the ladle, in words and figures of the shop floor."""

    name: str
    meaning: str
    count: int
    # by how much it moves what was measured over the fitted rows, RMS of a coordinate, what a shift of the outer frames
    # would do taken off; ``moved_mrad`` RMS of a rotation component, NaN where none was measured
    moved_mm: float
    moved_mrad: float


def group_effects(calibration: CalibrationFindings) -> list[GroupLine]:
    """Return what each group kept does at the target, to first order about the answer; the largest first."""
    fit, noise = calibration.fit, calibration.noise
    jacobian = fit.equations.derivatives
    frames, turned = jacobian[:, :FRAMES], are("rotation", fit.equations.components)
    lines, first = [], FRAMES
    for group in calibration.selection.groups:
        columns = slice(first, first + len(group.parameters))
        first = columns.stop
        effect = jacobian[:, columns] @ fit.unknowns.values[columns]
        effect -= frames @ np.linalg.lstsq(frames, effect, rcond=None)[0]
        move, turn = rms(effect[~turned]) * noise.length_m / MM, rms(effect[turned]) * noise.rotation_rad / MRAD
        lines.append(GroupLine(group.name, group.meaning, len(group.parameters), move, turn))
    return sorted(lines, key=lambda line: -line.moved_mm)


def combination_lines(calibration: CalibrationFindings) -> list[Movement]:
    """Return what the campaign determines, the surest movement first.

    Combinations with an outer frame in them say nothing of the robot.
    """
    base, fit = calibration.base, calibration.fit
    # The frames, those of sessions with frames of their own too.
    outer = (*base.names[:FRAMES], *(name for name in base.names[FRAMES:] if name.startswith(SESSION)))
    lines = []
    for combination in robot_combinations(base, outer):
        shares = np.zeros(len(base.names))
        for name, share in combination.items():
            shares[base.names.index(name)] = share
        unit, factor = _shown(calibration.unknown_units[base.names.index(next(iter(combination)))])
        std = float(np.sqrt(shares @ fit.covariance @ shares)) * calibration.inflation
        prior = float(np.linalg.norm(shares * fit.prior_std))
        value = float(shares @ fit.unknowns.values)
        lines.append(Movement(combination_text(combination), unit, value / factor, std / factor, prior / factor))
    return sorted(lines, key=lambda line: -line.surprise)
