"""Causes of a robot that declares none: every family, for its groups of drives, joints, links and thermometers."""

import functools
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.closed_chain import ClosedChainMechanism
from pouring_robot.mechanism.rotations import turn_to
from pouring_robot.robot.description.cause_types import (
    AMBIENT,
    METROLOGY_SCALE,
    AxisTilt,
    CauseEntry,
    Causes,
    Placements,
    Thermometers,
)
from pouring_robot.robot.description.definition import RobotDefinition
from pouring_robot.robot.description.drive import Drive

HARMONIC_SIZES = tuple(1.0 / order for order in range(1, 31))
"""Expected size of each order, relative to the first, of an error that is a function of a joint's own angle. Its origin
(encoder, gear, transmission) does not matter: an error whose steps around the turn are independent of each other, as
those of teeth, balls and graduation lines are, is a closed random walk, whose coefficients fall with the order."""
_ALONG = 0.999
_USUAL_MOMENT_NM = 100.0  # where no effort limits are stated: that of an arm that carries some 10 kg
_ZERO_MRAD = 10.0  # usual zero error of a joint: homed by marks, by eye, or a tooth of its gear off, half a degree
_NO_LIMITS_M, _LONGEST_M = (-1.0, 1.0), 100.0
"""Limits assumed for a slide without any, and the stroke from which on limits count as none."""
Groups = Mapping[str, tuple[Drive, ...]]


@functools.lru_cache(maxsize=16)
def causes_of(robot: RobotDefinition) -> Causes:
    """Return the causes that a robot declares; otherwise the default ones for its groups."""
    if robot.causes:
        return robot.causes
    mechanism, ambient = robot.mechanism(), replace(AMBIENT, by_pose=True, moves_joints=True)
    return Causes(
        entries=(*_of_drives(robot), *_coupled(robot, mechanism), *_bearings(robot, mechanism), *_of_structure(robot)),
        placements=_placements(robot, mechanism),
        thermometers=(ambient, *(_thermometer(name) for name in robot.thermometers)),
        drive_thermometers=_drive_thermometers(robot, mechanism),
    )


def _of_drives(robot: RobotDefinition) -> Iterator[CauseEntry]:
    """Yield the possible causes in drives, family by family, group by group."""
    groups = robot.groups
    slides = {name: drives for name, drives in groups.items() if drives[0].unit == "m"}
    turns = {name: drives for name, drives in groups.items() if drives[0].unit == "rad"}
    story = "the zeros of the drives are set wrong"
    for name, cause, own in _each(groups, "drive_zero_offset"):
        yield CauseEntry(cause, "zero", story, {**own, "size": _ZERO_MRAD if name in turns else 1.0})
    slide = "the drives move further or less far than commanded, in proportion or with build-up along the stroke"
    turn = "the drives turn further or less far than commanded, in proportion: by gear, belt or encoder"
    for name, cause, own in _each(groups, "drive_scale"):
        lead = CauseEntry(cause, "scale", slide, {**own, "build_up": True})
        yield lead if name in slides else CauseEntry(cause, "ratio", turn, own)
    story = "runout of screws or pinions: an error that repeats with every turn of the motor"
    for _, cause, own in _each(slides, "drive_periodic"):
        yield CauseEntry(cause, "periodic", story, {**own, "period": "pitch"})
    story = (
        "each joint has an error that is periodic in its own angle; poses cannot show whether encoder, gear or "
        "transmission causes it"
    )
    for _, cause, own in _each(turns, "joint_periodic"):
        yield CauseEntry(cause, "periodic", story, {**own, "sizes": HARMONIC_SIZES, "all_main": True})
    story = "nuts and gears have play: a drive stops short on the side it came from"
    for name, cause, own in _each(groups, "drive_backlash"):
        yield CauseEntry(cause, "lost_motion", story, {**own, "group": name if len(groups) > 1 else ""})
    story = "the drives yield to the forces that weight puts on them"
    for name, cause, own in _each(groups, "drive_compliance"):
        sizes: dict[str, Any]
        if name in slides:
            family, sizes = "stretch", {"load": robot.file.usual_force_n, "length_m": 1.0}
        else:
            family, sizes = "spring", {"load": _usual_moment(robot), "strengths": _strengths(robot, groups[name])}
        yield CauseEntry(cause, family, story, {**own, "group": name, **sizes})


def _coupled(robot: RobotDefinition, mechanism: ClosedChainMechanism) -> Iterator[CauseEntry]:
    """Yield the coupling of turning drives in open chains; in a loop each has its motor on the base."""
    joints = (drive.joint for drive in robot.drives if drive.unit == "rad")
    turns = tuple(sorted(joints, key=mechanism.shared_model.getJointId))
    if len(turns) > 1 and not mechanism.anchors:
        story = "a drive moves along with another one: its gears, belts or rods pass the other's joint"
        yield CauseEntry("drive_coupling", "coupling", story, {"drives": turns})


def _each(groups: Groups, id_: str) -> Iterator[tuple[str, str, dict[str, Any]]]:
    """Yield of each group its name, the id of its cause (with that name where there are several) and its drives."""
    for name, drives in groups.items():
        yield name, f"{id_}.{name}" if len(groups) > 1 else id_, {"drives": tuple(drive.joint for drive in drives)}


def _strengths(robot: RobotDefinition, drives: tuple[Drive, ...]) -> tuple[float, ...]:
    """Return the effort limits of drives in the URDF, in Nm; none where it does not state all of them."""
    model = robot.mechanism().shared_model
    said = [float(model.upperEffortLimit[model.idx_vs[model.getJointId(drive.joint)]]) for drive in drives]
    return tuple(said) if all(0.0 < limit < np.inf for limit in said) else ()


def _bearings(robot: RobotDefinition, mechanism: ClosedChainMechanism) -> Iterator[CauseEntry]:
    """Yield the tilting of joints in open chains; how joints in loops share moments depends on their stiffness.

    A bearing is expected to be as compliant as its drive; other joints and slides, as the strongest drive.
    """
    axes = {joint: _axis(mechanism, joint) for joint in robot.drawing().engine.structure.placed_joints}
    if mechanism.anchors or not any(axis.any() for axis in axes.values()):
        return
    turning = tuple(drive for drive in robot.drives if drive.unit == "rad")
    strong = dict(zip((drive.joint for drive in turning), _strengths(robot, turning), strict=False))
    middle = np.exp(np.log(list(strong.values())).mean()) if strong else 1.0
    slides = {joint for joint in axes if mechanism.unit_of(joint) == "m"}
    tilts = {
        joint: dict(zip("xyz", np.eye(3).tolist(), strict=True)) if joint in slides else _across(axis)
        for joint, axis in axes.items()
        if axis.any()
    }
    sizes = {joint: float(middle / strong.get(joint, max(strong.values(), default=1.0))) for joint in tilts}
    moving = slides - {*mechanism.loops.locked_joints}
    said = {joint: mechanism.joint_limits().get(joint, _NO_LIMITS_M) for joint in moving}
    ends = {joint: pair if 0.0 < pair[1] - pair[0] < _LONGEST_M else _NO_LIMITS_M for joint, pair in said.items()}
    strokes = {joint: (0.5 * (first + last), 0.5 * (last - first)) for joint, (first, last) in ends.items()}
    story = "bearings and links yield: joints tilt under the moment of what they carry"
    options = {"load": _usual_moment(robot), "tilts": tilts, "sizes": sizes, "strokes": strokes}
    yield CauseEntry("joint_compliance", "bearing", story, options)


def _across(axis: FloatArray) -> dict[str, list[float]]:
    """Return directions perpendicular to an axis, in a joint's placement, by name: u, v where it is not x, y or z."""
    names = [name for name, share in zip("xyz", np.abs(axis), strict=True) if share < _ALONG]
    if len(names) == 2:
        return {name: np.eye(3)["xyz".index(name)].tolist() for name in names}
    return dict(zip("uv", turn_to(axis).T[:2].tolist(), strict=True))


def _usual_moment(robot: RobotDefinition) -> float:
    """Return the moment at which compliance is stated, in Nm: the turning drives' effort limits, if the URDF has them.

    Gears and bearings of similar shape under the same stress yield by similar angles, so a small robot under its own
    load deviates from the drawing as much as a large one. It is the geometric mean, rounded.
    """
    if robot.file.usual_moment_nm is not None:
        return robot.file.usual_moment_nm
    said = _strengths(robot, tuple(drive for drive in robot.drives if drive.unit == "rad"))
    decades = np.log10(said).mean() if said else np.log10(_USUAL_MOMENT_NM)
    round_ones = np.log10([1.0, 2.0, 5.0, 10.0]) + np.floor(decades)
    return float(f"{10.0 ** round_ones[np.argmin(np.abs(round_ones - decades))]:.1g}")


def _of_structure(robot: RobotDefinition) -> Iterator[CauseEntry]:
    story = "joints are displaced on their links, or their axes tilted, compared with the drawing"
    if (robot.file.places, robot.file.axes) != ((), ()):
        yield CauseEntry("joint_placement", "placement", story)
    slides = any(drive.unit == "m" for drive in robot.drives)
    story = f"warm links{', screws or scales of slides' * slides} are longer than drawn"
    yield CauseEntry("link_thermal_expansion", "links_growth", story)
    for travel in robot.travels[:1]:
        story = "the beam that carries the base sinks under it and leans with the slope of its deflection"
        yield CauseEntry("base_deflection", "deflection", story, {"travel": f"{travel}_m", "weight_n": 1000.0})
    yield CauseEntry("base_drift", "base_drift", "the base creeps away from where it was when the campaign began")
    yield METROLOGY_SCALE
    story = "the base or the device is displaced in some sessions"
    yield CauseEntry("session_offset", "session_offset", story)


def _placements(robot: RobotDefinition, mechanism: ClosedChainMechanism) -> Placements:
    joints = robot.drawing().engine.structure.placed_joints
    robot.check_displaced(joints)
    along = robot.file.along
    tilts = []
    for joint in joints if robot.file.axes is None else dict.fromkeys(robot.file.axes):
        axis = _axis(mechanism, joint)
        if axis.any():
            across = "".join(name for name, share in zip("xyz", np.abs(axis), strict=True) if share < _ALONG)
            tilts.append(AxisTilt(joint, across, zeros=_zeros(robot, mechanism, joint, across)))
    return Placements(
        centres={"joints": tuple(joints if along is None else along)},
        tilts=tuple(tilts),
        centre_words={"joints": "joint places"},
        along=along or {},
    )


def _zeros(robot: RobotDefinition, mechanism: ClosedChainMechanism, joint: str, across: str) -> dict[str, str]:
    """Return the turning drive before a joint, by the component of the joint's tilt that is parallel to its axis."""
    model = mechanism.shared_model
    number = model.getJointId(joint)
    before = model.names[model.parents[number]]
    if before not in {drive.joint for drive in robot.drives if drive.unit == "rad"}:
        return {}
    along = np.abs(model.jointPlacements[number].rotation.T @ _axis(mechanism, before))
    return {axis: before for axis, share in zip("xyz", along, strict=True) if axis in across and share > _ALONG}


def _axis(mechanism: ClosedChainMechanism, joint: str) -> FloatArray:
    """Return the axis of a joint with one degree of freedom in its own placement, (3,); zeros for others."""
    model = mechanism.shared_model
    if not model.existJointName(joint) or model.nvs[model.getJointId(joint)] != 1:
        return np.zeros(3)
    return np.asarray(mechanism.joint_axes([model.getJointId(joint)]).reshape(2, 3).sum(axis=0))


def _thermometer(name: str) -> Thermometers:
    return Thermometers(
        name,
        f"temperature of {name}",
        f"{name} above reference",
        {name: f"temperature of {name}"},
        f"the temperature of {name} ({name}_degC)",
        f"measure the same poses at two temperatures of {name}",
        by_pose=True,
        moves_joints=True,
        expected=False,
        hot_rise_k=20.0,
    )


def _drive_thermometers(robot: RobotDefinition, mechanism: ClosedChainMechanism) -> dict[str, str]:
    """Return the thermometer on the link that each sliding drive moves."""
    model = mechanism.shared_model
    found = {}
    for drive in robot.drives:
        joint = model.getJointId(drive.joint)
        bodies = [f.name for f in model.frames if f.parentJoint == joint and f.name in robot.thermometers]
        if drive.unit == "m" and bodies:
            found[drive.joint] = bodies[0]
    return found
