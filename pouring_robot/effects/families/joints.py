"""Families of effects of joints: places displaced, axes tilted."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from pouring_robot.effects.base import EffectParameter, Family, Form
from pouring_robot.effects.conditions import Conditions
from pouring_robot.io.units import MM, MRAD
from pouring_robot.robot.tolerances import Tolerances, TolerancesByKind

Parameters = tuple[EffectParameter, ...]


def _usual(conditions: Conditions) -> TolerancesByKind:
    """Return the usual sizes: the tolerances of unmeasured parts."""
    return Tolerances.of(conditions.robot).kinds


def place_parameters(conditions: Conditions) -> dict[str, Parameters]:
    """Return up to three displacements for each joint whose place matters, each the tolerance of an unmeasured part."""
    placements, change = conditions.causes.placements, MM * np.ones(len(conditions))
    std_mm = _usual(conditions).joint_centre.std
    return {
        joint: tuple(
            EffectParameter(name, "mm", std_mm, {name: change})
            for name in (f"{joint}.t{axis}" for axis in placements.along.get(joint, "xyz"))
        )
        for joint in placements.places
    }


def axis_parameters(conditions: Conditions) -> dict[str, Parameters]:
    """Return the tilts of each joint's axis, by joint; the next joint is turned back where it is to stay.

    They are as large as the tolerance of an unmeasured part.
    """
    std_mrad, change = _usual(conditions).joint_axis.std, MRAD * np.ones(len(conditions))
    found: dict[str, Parameters] = {}
    for tilt in conditions.causes.placements.tilts:
        turned = [(joint, share * change) for joint, share in ((tilt.joint, 1.0), (tilt.after, tilt.back)) if joint]
        found[tilt.joint] = tuple(
            EffectParameter(f"{tilt.joint}.tilt_{axis}", "mrad", std_mrad, {f"{j}.r{axis}": turn for j, turn in turned})
            for axis in tilt.directions
        )
    return found


def _twists(conditions: Conditions) -> Parameters:
    """Return the twists, about joints' own axes, of what follows them."""
    std_mrad, change = _usual(conditions).joint_axis.std, MRAD * np.ones(len(conditions))
    twists = conditions.causes.placements.twists.items()
    return tuple(EffectParameter(name, "mrad", std_mrad, {f"{joint}.rz": change}) for name, joint in twists)


def together(found: Mapping[str, Parameters]) -> Parameters:
    """Return the parameters of all joints."""
    return tuple(parameter for parameters in found.values() for parameter in parameters)


@dataclass(eq=False)
class JointCentres(Family):
    """Joints displaced."""

    driven_by: str = ""  # condition that must vary for it to be observable

    def workmanship(self, conditions: Conditions) -> Parameters:
        """All places."""
        return together(place_parameters(conditions))

    def forms(self, conditions: Conditions) -> tuple[Form, ...]:
        """All places, those of one part of the machine, or a single one."""
        by_joint, parts = place_parameters(conditions), conditions.causes.placements.centres
        return (
            Form("all", together(by_joint)),
            *(Form(name, together({joint: by_joint[joint] for joint in joints})) for name, joints in parts.items()),
            *(Form(f"{joint}_alone", found) for joint, found in by_joint.items()),
        )


@dataclass(eq=False, kw_only=True)
class AxisTilts(Family):
    """Axes tilted."""

    driven_by: str = ""  # condition that must vary for it to be observable
    joints: Mapping[str, tuple[str, ...]]  # joints whose axes alone make a form, by form; one without has the twists

    def workmanship(self, conditions: Conditions) -> Parameters:
        """All axes, and twists."""
        return together(axis_parameters(conditions)) + _twists(conditions)

    def forms(self, conditions: Conditions) -> tuple[Form, ...]:
        """All axes and twists, or some of them."""
        by_joint, twists = axis_parameters(conditions), _twists(conditions)
        some = {name: together({j: by_joint[j] for j in joints}) or twists for name, joints in self.joints.items()}
        return (Form("all", self.workmanship(conditions)), *(Form(name, found) for name, found in some.items()))


@dataclass(eq=False)
class Placement(Family):
    """Joints displaced and their axes tilted."""

    driven_by = "position_m"

    def workmanship(self, conditions: Conditions) -> Parameters:
        """All places and axes."""
        return together(place_parameters(conditions)) + together(axis_parameters(conditions))

    def forms(self, conditions: Conditions) -> tuple[Form, ...]:
        """All places and axes, all of one kind, those of one joint, or a single one, such as a drawing's length."""
        places, axes = place_parameters(conditions), axis_parameters(conditions)
        kinds = {"places": together(places), "axes": together(axes)}
        every = kinds["places"] + kinds["axes"]
        kept = {name: found for name, found in kinds.items() if found}
        both = {"all": every} if len(kept) > 1 else {}
        alone = {f"{joint}_alone": found + axes.get(joint, ()) for joint, found in places.items()}
        single = {f"{one.name}_alone": (one,) for one in every}
        return tuple(Form(name, found) for name, found in (both | kept | alone | single).items())
