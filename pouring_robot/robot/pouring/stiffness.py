r"""Stiffness of a leg and its joints from their sections, lengths and bearings.

Bars and beams are those of W. Young and R. Budynas, Roark's Formulas for Stress and Strain, 7th ed.: a bar yields by
:math:`F L / (E A)`, a beam on two supports by :math:`F L^3 / (48 E I)` under its middle, a shaft turns by
:math:`T L / (G J)`. A roller bearing yields by Palmgren's :math:`\delta = 7.7 \cdot 10^{-5}\, Q^{0.9} / l^{0.8}`
(mm, N, mm) with :math:`Q = 4.6\, F / Z` on the most loaded of Z rollers (T. Harris, Rolling Bearing Analysis, ch. 6
and 7), so that its stiffness at a load is :math:`F / (0.9\, \delta)`.

In series along a leg are the gimbal (four sides of a square, each loaded in its middle), its trunnions' bearings, the
housing as a tube, thrust bearing and nut, the spindle as a bar down to the lower joint, and that joint's cross in the
fork and in the foot, with bearings. About the leg, a U joint transmits the spindle's torsion and frees the other
rotations. At an inclined leg the joints also convert torsion into bending; this is left out: at the workspace's largest
inclination of 0.32 rad it adds tan² 0.32 · G J / (E I), 8 %, to the torsional compliance. Leg 4 holds the tilt drive's
torque: a beam on two supports with a moment at one end, which rotates there by :math:`T L / (3 E I)`.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal, Self

import numpy as np
from pydantic import PositiveFloat

from pouring_robot.io.typed_yaml import Entry, StrictModel, read_yaml, validate
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.loops_file import AxialStiffness, TorsionStiffness
from pouring_robot.robot.description.urdf import description_folder
from pouring_robot.robot.pouring.layout_schema import Layout, Length

Modulus = Entry[PositiveFloat, Literal["N/m2"]]
_SHORTEST_SPINDLE_M = 0.05


class Steel(StrictModel):
    """Elastic constants."""

    youngs_modulus: Modulus
    shear_modulus: Modulus


class Bearing(StrictModel):
    """A needle bearing of a U joint."""

    rollers: Entry[PositiveFloat, Literal["1"]]
    roller_length: Length


class AxialPart(StrictModel):
    """A bought-in part with a stiffness along the leg."""

    axial: AxialStiffness


class TiltDrive(StrictModel):
    """The gearbox of the tilt drive."""

    torsion: TorsionStiffness


class Measured(StrictModel):
    """Measured stiffness values that replace computed ones, in N/m and Nm/rad."""

    leg_axial: PositiveFloat | None = None
    joint: PositiveFloat | None = None
    leg_torsion: PositiveFloat | None = None
    tilt_drive: PositiveFloat | None = None


class StiffnessProperties(StrictModel):
    """The stiffness file."""

    steel: Steel  # of all parts
    bearing: Bearing  # of the U joints
    nut: AxialPart  # of a leg's drive
    thrust_bearing: AxialPart
    tilt_drive: TiltDrive  # gearbox
    measured: Measured = Measured()  # values that replace computed ones


def load_stiffness(path: Path | str | None = None) -> StiffnessProperties:
    """Read a stiffness file (default: the shipped one); raises DescriptionError where it is missing or wrong."""
    path = Path(path) if path is not None else description_folder() / "config" / "stiffness.yaml"
    return validate(StiffnessProperties, read_yaml(path), path)


@dataclass(frozen=True)
class PartStiffness:
    """Stiffness of the parts that hold the platform at a pose; N/m and Nm/rad."""

    leg_axial: FloatArray  # of each leg's drive along it: spindle, housing, nut, thrust bearing; shape (4,)
    joint: float  # of both U joints of a leg along it
    leg_torsion: FloatArray  # of each leg about its axis, shape (4,)
    tilt_drive: float  # of θ46: gearbox and leg 4, which bends under its torque
    shares: dict[str, float]  # compliance along a leg of middle length by part, in m/N

    @classmethod
    def of(
        cls, layout: Layout, lengths_m: FloatArray, load_N: float, properties: StiffnessProperties | None = None
    ) -> Self:
        """Compute it for a layout, leg lengths (4,), in m, and a load along a leg, in N, on the bearings."""
        given = properties or load_stiffness()
        leg, E, G = layout.leg, given.steel.youngs_modulus.value, given.steel.shear_modulus.value
        spindle_m = np.maximum(lengths_m - leg.housing_below.metres, _SHORTEST_SPINDLE_M)
        radius = leg.spindle_radius.metres
        outer, inner = leg.housing_outer_radius.metres, leg.housing_inner_radius.metres
        drive = {
            "housing": leg.housing_below.metres / (E * np.pi * (outer**2 - inner**2)),
            "thrust bearing": 1.0 / given.thrust_bearing.axial.value,
            "nut": 1.0 / given.nut.axial.value,
        }
        spindle = spindle_m / (E * np.pi * radius**2)
        bearing = _bearing(given.bearing, 0.5 * load_N)
        length, below = float(lengths_m[3]), min(leg.housing_below.metres, float(lengths_m[3]))
        rod, tube = 0.25 * np.pi * radius**4, 0.25 * np.pi * (outer**4 - inner**4)
        # Leg 4's bending moment falls to zero at the upper joint; the housing is the upper part.
        bent = (length / rod + (below / length) ** 3 * length * (1.0 / tube - 1.0 / rod)) / (3.0 * E)
        cross = 0.25 * np.pi * leg.cross_radius.metres**4
        joint = {
            "gimbal": beam(E, leg.gimbal_bar.metres**4 / 12.0, 2.0 * leg.gimbal_half_width.metres),
            "cross in the fork": beam(E, cross, 2.0 * leg.fork_half_gap.metres),
            "cross in the foot": beam(E, cross, 2.0 * leg.foot_half_gap.metres),
            # Two bearings side by side carry the leg at each of four trunnion pairs.
            "bearings": 4.0 * 0.5 * bearing,
        }
        torsion = G * 0.5 * np.pi * radius**4 / spindle_m
        measured = given.measured
        return cls(
            leg_axial=np.full(4, measured.leg_axial) if measured.leg_axial else 1.0 / (spindle + sum(drive.values())),
            joint=measured.joint or 1.0 / sum(joint.values()),
            leg_torsion=np.full(4, measured.leg_torsion) if measured.leg_torsion else torsion,
            tilt_drive=measured.tilt_drive or 1.0 / (1.0 / given.tilt_drive.torsion.value + bent),
            shares=joint | drive | {"spindle": float(spindle.mean())},
        )


def beam(E: float, inertia: float, span: float) -> float:
    """Return the compliance at the middle of a beam on two supports, in m/N.

    A gimbal's four sides are two pairs in series, each of two parallel sides: as compliant as one side.
    """
    return float(span**3 / (48.0 * E * inertia))


def _bearing(bearing: Bearing, load_N: float) -> float:
    """Return the compliance of a roller bearing at a load, in m/N."""
    most = 4.6 * load_N / bearing.rollers.value
    yields_mm = 7.7e-5 * most**0.9 / (1e3 * bearing.roller_length.metres) ** 0.8
    return float(0.9 * yields_mm * 1e-3 / load_N)
