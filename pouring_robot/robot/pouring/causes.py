"""Causes of error of the pouring robot: its fourteen effects and their parts, its thermometers, its part names."""

from pouring_robot.robot.description.cause_types import (
    AMBIENT,
    METROLOGY_SCALE,
    AxisTilt,
    CauseEntry,
    Causes,
    PartNames,
    Placements,
    Thermometers,
)
from pouring_robot.robot.pouring.names import CHAIN_JOINTS, DRIVE_JOINTS, LEGS, SEATS

_LEGS, _TILT = DRIVE_JOINTS[:3], DRIVE_JOINTS[3:]
_UPPER = tuple(joints[0] for joints in CHAIN_JOINTS)
_STROKE = {"middle_m": 0.55, "half_stroke_m": 0.2}
_TILTED = ("xz", "yz", "xy", "yz", "xz")
"""Directions perpendicular to the axis of each joint of a leg."""
_PLATFORMS = {"fixed_platform": _UPPER, "moving_platform": SEATS}
_BORES = tuple(joint for joints in CHAIN_JOINTS for joint in (joints[0], joints[4]))


CAUSES = Causes(
    entries=(
        CauseEntry(
            "drive_zero_offset",
            "zero",
            "the zeros of the drives are set wrong",
            {"drives": DRIVE_JOINTS, "driven_by": "tilt_rad"},
        ),
        CauseEntry(
            "drive_scale",
            "scale",
            "the lead of the screws is not what the controller believes",
            {"drives": _LEGS, **_STROKE},
        ),
        CauseEntry(
            "drive_cyclic",
            "periodic",
            "runout of the screws: an error that repeats with every turn",
            {"drives": _LEGS, "period": "screw_pitch_m"},
        ),
        CauseEntry(
            "drive_backlash",
            "lost_motion",
            "nuts and gears have play: a drive stops short on the side it came from",
            {"drives": DRIVE_JOINTS, **_STROKE},
        ),
        CauseEntry(
            "joint_centre_offset",
            "centres",
            "the U joints are not where the drawing puts them on their platforms",
            {"driven_by": "tilt_rad"},
        ),
        CauseEntry(
            "joint_axis_tilt",
            "tilts",
            "axes of the U joints are not parallel as drawn, or the yokes of a leg are twisted",
            {"driven_by": "tilt_rad", "joints": {"twisted_legs": (), "bores": _BORES}},
        ),
        CauseEntry(
            "leg_thermal_expansion",
            "drive_growth",
            "warm legs are longer than the controller believes",
            {"drives": _LEGS, "thermometers": "leg", "neighbour": "platform"},
        ),
        CauseEntry(
            "platform_thermal_expansion",
            "link_growth",
            "the warm moving platform carries its U joints further apart than drawn",
            {"joints": SEATS, "thermometer": "platform"},
        ),
        CauseEntry(
            "leg_compliance",
            "stretch",
            "the legs stretch under the weight they carry",
            {"drives": _LEGS, "group": "legs", "load": 5000.0, "length_m": 0.6},
        ),
        CauseEntry(
            "tilt_drive_compliance",
            "spring",
            "the tilt drive yields to the moment of the ladle",
            {"drives": _TILT, "group": "tilt", "load": 2000.0},
        ),
        CauseEntry(
            "truss_deflection",
            "deflection",
            "the truss sinks under the carriage and leans with the slope of its deflection",
            {"travel": "truss_travel_m", "weight_n": 6500.0},
        ),
        CauseEntry(
            "base_drift", "base_drift", "the fixed platform creeps away from where it was when the campaign began"
        ),
        CauseEntry(
            "tilt_encoder_eccentricity",
            "periodic",
            "the disc of the tilt encoder sits off centre",
            {"drives": _TILT, "sizes": (1.0, 0.25)},
        ),
        METROLOGY_SCALE,
    ),
    placements=Placements(
        centres=_PLATFORMS,
        tilts=tuple(
            AxisTilt(name, directions, after, 1.0 if after == seat else -1.0)
            for joints, seat in zip(CHAIN_JOINTS, SEATS, strict=True)
            for name, after, directions in zip(joints, (*joints[1:], seat), _TILTED, strict=True)
        ),
        centre_words={"fixed_platform": "upper joint centres", "moving_platform": "lower joint centres"},
        axis_groups={"axes on the platforms": _BORES},
        twists={f"{leg}_twist": f"{leg}_s4" for leg in LEGS},
        twist_words="twist of the legs",
    ),
    thermometers=(
        Thermometers(
            "melt",
            "melt temperature",
            "melt above reference",
            {"melt": "melt temperature"},
            "the temperature of the melt (melt_degC)",
            "measure the same poses with a hot and with a cold melt",
            by_pose=True,
            hot_degC=1600.0,
        ),
        AMBIENT,
        Thermometers(
            "leg",
            "leg temperatures",
            "mean leg above reference",
            {leg: f"leg {k + 1} temperature" for k, leg in enumerate(LEGS)},
            f"the temperature of every leg ({LEGS[0]}_degC to {LEGS[-1]}_degC)",
            "measure the same poses at two temperatures of the legs",
            hot_rise_k=100.0,
        ),
        Thermometers(
            "platform",
            "platform temperature",
            "platform above reference",
            {"platform": "platform temperature"},
            "the temperature of the platform (platform_degC)",
            "measure the same poses at two temperatures of the platform",
            by_pose=True,
            moves_joints=True,
            hot_rise_k=130.0,
        ),
    ),
    drive_thermometers=dict(zip(_LEGS, LEGS, strict=False)),
    words=PartNames(
        base="fixed platform",
        body="platform",
        moved="ladle",
        tip="pouring lip",
        groups={"tilt": "tilt drive"},
        force={"legs": "mean pull of the legs [kN]", "tilt": "moment on the tilt drive [kNm]"},
    ),
    travel_words={
        "truss_travel": (
            "the position along the rails (truss_travel_m)",
            "measure at both ends and in the middle of the rails, empty and full",
        )
    },
    own_weight=False,
)
