"""A dimensions file for a user's own machine: the shipped file with the owner's sizes, and checks of the result.

Joint limits that are not given are what the workspace needs, plus a margin. Poses are singular where small errors of
the drives cause large errors of the platform: where the smallest singular value of ∂drives/∂pose vanishes. The tilt
counts as a length at the arm of the moving U joints, so that all components are in metres.
"""

import math
from dataclasses import dataclass, field, fields
from typing import Any, Self

import numpy as np
import yaml
from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedMap

from pouring_robot.exceptions import BadInputError
from pouring_robot.io.files import read_text
from pouring_robot.io.typed_yaml import yaml_text
from pouring_robot.io.units import MM
from pouring_robot.mechanism.arrays import FloatArray, grid
from pouring_robot.mechanism.joint_limits import in_limits
from pouring_robot.robot.pouring.kinematics import chain_joints
from pouring_robot.robot.pouring.layout import load_layout, shipped_layouts_file
from pouring_robot.robot.pouring.names import CHAIN_JOINTS

Pair = tuple[float, float]
_SHARES = np.linspace(0.0, 1.0, 7)
_MARGIN = {"rad": 0.08, "mm": 20.0}
_STEP = 1e-6
_OWNER = "as the owner says"
_SIGNS = np.array([[-1, 1], [-1, -1], [1, 1], [1, -1]])


@dataclass(frozen=True)
class NewLayout:
    """The sizes that the owner of a machine gives; the U joints of each platform are at the corners of a rectangle.

    Sizes that are not positive, and ranges that do not go from low to high, raise BadInputError.
    """

    name: str = field(metadata={"asked": "Name of the machine (one word)"})
    fixed_mm: Pair = field(metadata={"asked": "Distances of the upper U-joint centres along x and y, mm"})
    moving_mm: Pair = field(metadata={"asked": "Distances of the lower U-joint centres along x and y, mm"})
    x_mm: Pair = field(metadata={"asked": "Workspace of the moving platform along x, from to, mm"})
    y_mm: Pair = field(metadata={"asked": "... along y, mm"})
    z_mm: Pair = field(metadata={"asked": "... along z (below the fixed platform is negative), mm"})
    tilt_deg: Pair = field(metadata={"asked": "... its tilt, degrees (positive lowers the lip)"})
    payload_kg: float = field(metadata={"asked": "Largest mass of melt, kg"})
    tare_kg: float = field(metadata={"asked": "Mass of the empty ladle, kg"})
    stroke_mm: Pair | None = None  # shortest and longest leg; None: what the workspace needs

    def __post_init__(self) -> None:
        if not self.name.isidentifier() or yaml.safe_load(self.name) != self.name:  # to xacro's YAML a switch
            raise BadInputError(
                f"the name '{self.name}' must be one word of letters, digits and _, but not a word such as 'on'"
            )
        for name in ("fixed_mm", "moving_mm", "stroke_mm", "payload_kg", "tare_kg"):
            value = getattr(self, name)
            if value is not None and not (np.isfinite(value).all() and np.min(value) > 0.0):
                raise BadInputError(f"{name}: sizes and masses must be above zero, not {value}")
        for name in ("x_mm", "y_mm", "z_mm", "tilt_deg", "stroke_mm"):
            low, high = getattr(self, name) or (0.0, 1.0)
            if not -math.inf < low < high < math.inf:
                raise BadInputError(f"{name}: give the lower end first, not {low:g} to {high:g}")
        if self.z_mm[1] >= 0.0:
            raise BadInputError(f"z_mm: the platforms meet at z = 0, below {self.z_mm[1]:g} mm; lower z")

    @classmethod
    def usual(cls) -> Self:
        """Return the paper's robot, under another name."""
        paper = load_layout()
        corners = [np.ptp(one.metres, axis=0)[:2] / MM for one in (paper.fixed_centres, paper.moving_centres)]
        *edges, tilt = np.transpose(paper.box)
        sizes = (*corners, *(edge / MM for edge in edges), np.degrees(tilt))
        fixed, moving, x, y, z, turn = ((round(float(a), 3), round(float(b), 3)) for a, b in sizes)
        return cls("mine", fixed, moving, x, y, z, turn, paper.ladle.payload.value, paper.ladle.tare.value)

    def centres_mm(self, sides: Pair) -> FloatArray:
        """Return the corners of a rectangle of these sides, (4, 3), chains 1 to 4."""
        return np.column_stack([0.5 * np.array(sides) * _SIGNS, np.zeros(4)])

    @property
    def poses(self) -> FloatArray:
        """A grid over the workspace with its corners, (n, 4): x, y, z in m, tilt in rad."""
        ranges = [MM * np.array(pair) for pair in (self.x_mm, self.y_mm, self.z_mm)]
        edges = [*ranges, np.radians(self.tilt_deg)]
        return grid(*(low + (high - low) * _SHARES for low, high in edges))

    def joints(self, poses: FloatArray) -> FloatArray:
        """Return the joints S1 to S5 of all chains at poses (n, 4), (n, 4, 5), in m and rad."""
        fixed, moving = (MM * self.centres_mm(sides) for sides in (self.fixed_mm, self.moving_mm))
        return chain_joints(fixed, moving, poses[:, :3], poses[:, 3])

    def limits(self) -> dict[str, tuple[Pair, str]]:
        """Return limits of S1 to S5 with their unit, mm or rad: as given, or what the workspace needs plus a margin."""
        values = self.joints(self.poses)
        found = {}
        for k in range(5):
            unit, factor = ("mm", 1.0 / MM) if k == 2 else ("rad", 1.0)
            low, high = factor * float(values[..., k].min()), factor * float(values[..., k].max())
            found[f"s{k + 1}"] = (round(low - _MARGIN[unit], 3), round(high + _MARGIN[unit], 3)), unit
        if self.stroke_mm:
            found["s3"] = self.stroke_mm, "mm"
        if found["s3"][0][0] <= 0.0:
            raise BadInputError(
                f"a leg would be {found['s3'][0][0]:.0f} mm long: the platforms meet inside the workspace; lower z"
            )
        return found

    def file_text(self) -> str:
        """Return the text of the dimensions file: the shipped one, with only this layout."""
        content = YAML().load(read_text(shipped_layouts_file()))
        entry = content["layouts"].pop("paper")
        for other in tuple(content["layouts"]):
            del content["layouts"][other]
        content["layouts"][self.name], usual = entry, self.usual()
        workspace, ladle = content["common"]["workspace"], content["common"]["ladle"]
        for key, place, value, unit in (
            ("x_mm", workspace["x"], list(self.x_mm), "mm"),
            ("y_mm", workspace["y"], list(self.y_mm), "mm"),
            ("z_mm", workspace["z"], list(self.z_mm), "mm"),
            ("tilt_deg", workspace["tilt"], list(self.tilt_deg), "deg"),
            ("payload_kg", ladle["payload"], self.payload_kg, "kg"),
            ("tare_kg", ladle["tare"], self.tare_kg, "kg"),
            ("fixed_mm", entry["fixed_centres"], self.centres_mm(self.fixed_mm).tolist(), "mm"),
            ("moving_mm", entry["moving_centres"], self.centres_mm(self.moving_mm).tolist(), "mm"),
        ):
            if getattr(self, key) != getattr(usual, key):
                _say(place, value, unit, _OWNER)
        limits, leg = self.limits(), content["common"]["leg"]
        through = limits["s3"][0][1] + leg["housing_above"]["value"]  # the rod extends beyond the nut and conducts heat
        if through > leg["spindle_length"]["value"]:
            _say(leg["spindle_length"], round(through, 3), "mm", "through the housing at full reach")
        for key, (pair, unit) in limits.items():
            whose = _OWNER if key == "s3" and self.stroke_mm else "what the workspace needs"
            _say(entry["joint_limits"][key], list(pair), unit, whose)
        return yaml_text(content, width=120)


QUESTIONS: dict[str, str] = {one.name: one.metadata["asked"] for one in fields(NewLayout) if one.metadata}
"""Questions to the owner, by field."""


def _say(entry: CommentedMap, value: Any, unit: str, whose: str) -> None:
    """Set the value of an entry, and replace its source and note."""
    entry["value"], entry["unit"], entry["source"], entry["note"] = value, unit, "assumed", whose


@dataclass(frozen=True)
class CheckedLayout:
    """How well a layout reaches its workspace, and how well its drives hold the platform there."""

    poses: int  # how many poses were checked
    reached: int  # how many of them are within all limits
    limiting: dict[str, int]  # number of poses out of reach, by limiting joint
    needed_mm: Pair  # shortest and longest leg that the workspace needs
    amplified: Pair  # platform error in mm per mm of drive error in the worst direction: median and maximum
    worst: tuple[float, ...]  # pose of the maximum, (4,): x, y, z in mm, tilt in degrees
    singular: bool  # whether the drives do not hold the platform at some pose, or a singularity lies between poses


def checked(layout: NewLayout) -> CheckedLayout:
    """Check whether a layout reaches its workspace, and whether its drives hold the platform everywhere in it."""
    poses = layout.poses
    joints, factors = layout.joints(poses), {"mm": 1.0 / MM, "rad": 1.0}
    beyond: dict[str, int] = {}
    within = np.ones(len(poses), dtype=bool)
    for k, ((low, high), unit) in enumerate(layout.limits().values()):
        values = factors[unit] * joints[..., k]
        wrong = ~in_limits(values, low, high)
        beyond |= {CHAIN_JOINTS[leg][k]: int(wrong[:, leg].sum()) for leg in np.flatnonzero(wrong.any(axis=0))}
        within &= ~wrong.any(axis=1)
    arm = MM * 0.5 * math.hypot(*layout.moving_mm)
    slopes = _slopes(layout, poses) / np.array([1.0, 1.0, 1.0, arm])
    slopes[:, 3] *= arm
    weakest = np.linalg.svd(slopes, compute_uv=False)[:, -1]
    sides = np.sign(np.linalg.det(slopes))
    worst = int(weakest.argmin())
    place = (*(poses[worst, :3] / MM).tolist(), math.degrees(poses[worst, 3]))
    amplified = 1.0 / np.maximum(weakest, 1.0 / _UNBOUNDED)
    needed = (float(joints[..., 2].min()) / MM, float(joints[..., 2].max()) / MM)
    figures = float(np.median(amplified)), float(amplified.max())
    singular = bool(figures[1] > _HELD or (sides != sides[0]).any())
    return CheckedLayout(len(poses), int(within.sum()), beyond, needed, figures, place, singular)


_HELD = 100.0
"""Amplification of drive errors above which the platform does not count as held: 0.1 mm become a centimetre, which is
the accuracy that pouring needs."""
_UNBOUNDED = 1e6  # amplification above which the figure is round-off


def _slopes(layout: NewLayout, poses: FloatArray) -> FloatArray:
    """Return ∂drives/∂pose of legs 1 to 3 and the tilt drive, (n, 4, 4), by central differences."""
    columns = []
    for step in _STEP * np.eye(4):
        plus, minus = (layout.joints(poses + sign * step) for sign in (1.0, -1.0))
        change = (plus - minus) / (2.0 * _STEP)
        columns.append(np.column_stack([change[:, :3, 2], change[:, 3, 4]]))
    return np.stack(columns, axis=-1)


def check_lines(found: CheckedLayout) -> list[str]:
    """Return the results of the check, in sentences."""
    low, high = found.needed_mm
    lines = [f"the workspace needs legs of {low:.1f} to {high:.1f} mm"]
    lines.append(f"{found.reached} of {found.poses} poses over the workspace are within all joint limits")
    lines += [f"  {joint} is beyond its limits in {count} of them" for joint, count in found.limiting.items()]
    median, most = found.amplified
    x, y, z, tilt = found.worst
    lines.append(
        f"a drive error moves the platform by {_times(median)} its size at worst (median of the poses), "
        f"{_times(most)} at x {x:z.0f}, y {y:z.0f}, z {z:z.0f} mm, tilt {tilt:z.1f} deg"
    )
    if found.singular:
        where = "most poses of the workspace are singular" if median > _HELD else "a pose of the workspace is singular"
        lines.append(f"warning: {where}, where the drives do not hold the platform")
    return lines


def _times(factor: float) -> str:
    return f"{factor:.2f} times" if factor < _UNBOUNDED else "without bound, over a million times"
