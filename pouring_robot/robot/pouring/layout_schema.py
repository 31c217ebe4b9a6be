"""Schema of the dimensions file: its keys, and the values that each may have.

Every entry is ``{value, unit, source, note}``. Unknown keys, wrong units, sizes that are not positive and
numbers that are not finite are refused. The properties ``metres`` and ``radians`` give SI values.
"""

from typing import Annotated, Any, Literal, cast

import numpy as np
from numpy.typing import ArrayLike
from pydantic import AfterValidator, Field, PositiveFloat

from pouring_robot.io.typed_yaml import Entries, Entry, StrictModel, Unit, Value
from pouring_robot.io.units import UNITS
from pouring_robot.mechanism.arrays import FloatArray, grid

_PER_SI = UNITS["length"] | UNITS["angle"]


def _ordered(bounds: tuple[float, float]) -> tuple[float, float]:
    if bounds[0] >= bounds[1]:
        raise ValueError(f"lower bound {bounds[0]:g} must be below upper bound {bounds[1]:g}")
    return bounds


Bounds = Annotated[tuple[float, float], AfterValidator(_ordered)]
Point = tuple[float, float, float]
Share = Annotated[float, Field(ge=0.0, le=1.0)]
MeshName = Annotated[str, Field(pattern=r"^[A-Za-z0-9_-]+\.(stl|obj)$")]


def _divided(value: Any, by: float) -> Any:
    return tuple(_divided(part, by) for part in value) if isinstance(value, tuple) else value / by


def _si(entry: Entry[Value, Unit]) -> Value:
    return cast("Value", _divided(entry.value, _PER_SI[str(entry.unit)][0]))


class InMetres(Entry[Value, Unit]):
    """An entry whose values are lengths."""

    @property
    def metres(self) -> Value:
        """Value in m."""
        return _si(self)


class InRadians(Entry[Value, Unit]):
    """An entry whose values are angles."""

    @property
    def radians(self) -> Value:
        """Value in rad."""
        return _si(self)


Length = InMetres[PositiveFloat, Literal["mm", "m"]]
Position = InMetres[Point, Literal["mm", "m"]]
Centres = InMetres[tuple[Point, Point, Point, Point], Literal["mm", "m"]]
"""Four points, one per chain."""
LengthRange = InMetres[Bounds, Literal["mm", "m"]]
Angle = InRadians[PositiveFloat, Literal["rad", "deg"]]
AngleRange = InRadians[Bounds, Literal["rad", "deg"]]
Mass = Entry[PositiveFloat, Literal["kg"]]
Density = Entry[PositiveFloat, Literal["kg/m3"]]
Speed = Entry[PositiveFloat, Literal["m/s", "mm/s"]]
Spin = Entry[PositiveFloat, Literal["rad/s"]]
Force = Entry[PositiveFloat, Literal["N"]]
Torque = Entry[PositiveFloat, Literal["Nm"]]
Colour = Entry[tuple[Share, Share, Share, Share], Literal["rgba"]]
Mesh = Entry[MeshName, Literal["file"]]


class Workspace(StrictModel):
    """Box for the moving platform's origin, range of its tilt, and the required accuracy."""

    x: LengthRange
    y: LengthRange
    z: LengthRange
    tilt: AngleRange
    accuracy: Length


class Ladle(StrictModel):
    """The ladle: masses, truncated cone, lip."""

    payload: Mass
    tare: Mass
    centre_of_mass: Position
    rim_centre: Position
    outer_radius_top: Length
    outer_radius_bottom: Length
    height: Length
    wall: Length
    rim_flange: Length
    rim_flange_height: Length
    lip_reach: Length
    lip_half_angle: Angle
    melt_below_rim: Length
    melt_thickness: Length
    trunnion_radius: Length
    mesh: Mesh


class Truss(StrictModel):
    """Rails, bridge and trolley."""

    span: Length
    gauge: Length
    trolley_stroke: Length
    platform_height: Length
    platform_drop: Length
    girder_width: Length
    girder_height: Length
    girder_wall: Length
    girder_offset: Length
    carriage_length: Length
    wheel_radius: Length
    wheel_width: Length
    rail_width: Length
    rail_height: Length
    rail_overhang: Length
    post_width: Length
    post_foot: Length
    trolley_length: Length
    trolley_bar: Length


class FixedPlatform(StrictModel):
    """Fixed platform, which carries the upper U joints."""

    bar_width: Length
    bar_height: Length
    bearing_offset: Length
    overhang: Length


class MovingPlatform(StrictModel):
    """Moving platform, which carries the lower U joints and the ladle."""

    bar_width: Length
    bar_height: Length
    hanger_gap: Length
    hanger_width: Length
    hanger_thickness: Length
    trunnion_drop: Length


class Leg(StrictModel):
    """One UPU chain; all four are identical."""

    gimbal_half_width: Length
    gimbal_bar: Length
    trunnion_radius: Length
    housing_outer_radius: Length
    housing_inner_radius: Length
    housing_below: Length
    housing_above: Length
    motor_radius: Length
    motor_length: Length
    belt_case_height: Length
    spindle_radius: Length
    spindle_length: Length
    fork_half_gap: Length
    fork_height: Length
    cheek_thickness: Length
    cheek_width: Length
    cross_radius: Length
    cross_block: Length
    foot_half_gap: Length
    foot_drop: Length
    sole_thickness: Length
    sole_length: Length


class Ratings(StrictModel):
    """Velocity and effort limits of the joints."""

    travel_speed: Speed
    travel_force: Force
    leg_speed: Speed
    leg_force: Force
    joint_speed: Spin
    joint_torque: Torque
    drag: Entry[Share, Literal["1"]] | None = None  # a joint's resistance at rated speed over its rated force


class Materials(StrictModel):
    """Density of the steel, colours of the drawing."""

    steel_density: Density
    rail_colour: Colour
    truss_colour: Colour
    platform_colour: Colour
    joint_colour: Colour
    housing_colour: Colour
    rod_colour: Colour
    ladle_colour: Colour
    melt_colour: Colour


class JointLimits(StrictModel):
    """Limits of a chain's joints S1 to S5."""

    s1: AngleRange
    s2: AngleRange
    s3: LengthRange
    s4: AngleRange
    s5: AngleRange


class Common(Entries):
    """Sections that layouts share."""

    workspace: Workspace
    ladle: Ladle
    truss: Truss
    fixed_platform: FixedPlatform
    moving_platform: MovingPlatform
    leg: Leg
    ratings: Ratings
    materials: Materials


class Layout(Common):
    """One complete layout: sizes of every part, as in the file."""

    fixed_centres: Centres
    moving_centres: Centres
    joint_limits: JointLimits

    @property
    def box(self) -> tuple[FloatArray, FloatArray]:
        """Lower and upper corner of the workspace, (4,) each: x, y, z of the moving platform in m, its tilt in rad."""
        at = self.workspace
        lower, upper = np.transpose([at.x.metres, at.y.metres, at.z.metres, at.tilt.radians])
        return lower, upper

    def grid(self, *shares: ArrayLike) -> FloatArray:
        """Return poses at all combinations of shares (0 to 1) of the box along x, y, z and tilt, shape (n, 4)."""
        lower, upper = self.box
        return np.asarray(lower + (upper - lower) * grid(*shares))


class LayoutsFile(StrictModel):
    """The dimensions file."""

    common: Common | None = None
    layouts: Annotated[dict[str, Layout], Field(min_length=1)]
