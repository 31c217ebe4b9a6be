"""Families of effects of joints: places displaced, axes tilted."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from pouring_robot.effects.base import EffectParameter, Form
from pouring_robot.effects.conditions import Conditions
from pouring_robot.effects.families.base import Family
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.poses import MM, MRAD
from pouring_robot.robot.description.causes import Placements
from pouring_robot.robot.tolerances import Tolerances

Parameters = tuple[EffectParameter, ...]


def place_parameters(placements: Placements, one: FloatArray) -> dict[str, Parameters]:
    """Return three parameters for each joint whose place counts; ``one`` is 1 for every row.

    They are as large as the tolerance of a part that nobody has measured.
    """
    std_mm = Tolerances.load(placements.tolerances).kinds.joint_centre.std
    return {
        joint: tuple(
            EffectParameter(f"{joint}.t{axis}", "mm", std_mm, {f"{joint}.t{axis}": MM * one})
            for axis in placements.along.get(joint, "xyz")
        )
        for joint in placements.places
    }


def axis_parameters(placements: Placements, one: FloatArray) -> dict[str, Parameters]:
    """Return the tilts of each joint's axis, by joint: only this axis turns, if the next joint is to stay.

    They are as large as the tolerance of a part that nobody has measured.
    """
    std_mrad = Tolerances.load(placements.tolerances).kinds.joint_axis.std
    return {
        tilt.joint: tuple(
            EffectParameter(
                f"{tilt.joint}.tilt_{axis}",
                "mrad",
                std_mrad,
                {f"{tilt.joint}.r{axis}": MRAD * one}
                | ({f"{tilt.after}.r{axis}": tilt.back * MRAD * one} if tilt.after else {}),
            )
            for axis in tilt.directions
        )
        for tilt in placements.tilts
    }


def together(found: Mapping[str, Parameters]) -> Parameters:
    """Return the parameters of all joints."""
    return tuple(parameter for parameters in found.values() for parameter in parameters)


class Centres(Family):
    """Joints displaced.

    Args:
        id_: as of :class:`Family`.
        story: likewise.
        driven_by: condition that must vary so that it shows.
    """

    def __init__(self, id_: str, story: str, driven_by: str) -> None:
        """Keep it."""
        super().__init__(id_, story)
        self.driven_by = driven_by

    def workmanship(self, conditions: Conditions) -> Parameters:
        """All places."""
        one = np.ones(len(conditions))
        return together(place_parameters(conditions.causes.placements, one))

    def forms(self, conditions: Conditions) -> tuple[Form, ...]:
        """All places, those of one part of the machine, or a single one."""
        placements = conditions.causes.placements
        by_joint = place_parameters(placements, np.ones(len(conditions)))
        parts = {name: [by_joint[joint] for joint in joints] for name, joints in placements.centres.items()}
        return (
            Form("all", together(by_joint)),
            *(Form(name, tuple(p for found in parameters for p in found)) for name, parameters in parts.items()),
            *(Form(f"{joint}_alone", found) for joint, found in by_joint.items()),
        )


class Tilts(Family):
    """Axes tilted.

    Args:
        id_: as of :class:`Family`.
        story: likewise.
        driven_by: condition that must vary so that it shows.
        forms: of some joints' axes alone, by form; that without joints has the twists.
    """

    loosened_by_load = True

    def __init__(self, id_: str, story: str, driven_by: str, forms: Mapping[str, tuple[str, ...]]) -> None:
        """Keep the forms."""
        super().__init__(id_, story)
        self.driven_by, self.joints = driven_by, forms

    def workmanship(self, conditions: Conditions) -> Parameters:
        """All axes, and twists."""
        one, placements = np.ones(len(conditions)), conditions.causes.placements
        return together(axis_parameters(placements, one)) + _twists(placements, one)

    def forms(self, conditions: Conditions) -> tuple[Form, ...]:
        """All axes and twists, or some of them."""
        one, placements = np.ones(len(conditions)), conditions.causes.placements
        by_joint, twists = axis_parameters(placements, one), _twists(placements, one)
        some = {
            name: tuple(p for joint in joints for p in by_joint[joint]) or twists
            for name, joints in self.joints.items()
        }
        return (Form("all", self.workmanship(conditions)), *(Form(name, found) for name, found in some.items()))


def _twists(placements: Placements, one: FloatArray) -> Parameters:
    std_mrad = Tolerances.load(placements.tolerances).kinds.joint_axis.std
    return tuple(
        EffectParameter(name, "mrad", std_mrad, {f"{joint}.rz": MRAD * one})
        for name, joint in placements.twists.items()
    )


class Placement(Family):
    """Joints displaced and their axes tilted.

    Args:
        id_: as of :class:`Family`.
        story: likewise.
        loosened_by_load: as :attr:`Effect.loosened_by_load`.
    """

    driven_by = "position_m"

    def __init__(self, id_: str, story: str, loosened_by_load: bool) -> None:
        """Keep it."""
        super().__init__(id_, story)
        self.loosened_by_load = loosened_by_load

    def workmanship(self, conditions: Conditions) -> Parameters:
        """All places and axes."""
        one, placements = np.ones(len(conditions)), conditions.causes.placements
        places = place_parameters(placements, one)
        return together(places) + together(axis_parameters(placements, one))

    def forms(self, conditions: Conditions) -> tuple[Form, ...]:
        """All places and axes, all of one kind, or those of a single joint."""
        one, placements = np.ones(len(conditions)), conditions.causes.placements
        places, axes = place_parameters(placements, one), axis_parameters(placements, one)
        kinds = {"places": together(places), "axes": together(axes)}
        kept = {name: found for name, found in kinds.items() if found}
        both = {"all": kinds["places"] + kinds["axes"]} if len(kept) > 1 else {}
        alone = {f"{joint}_alone": found + axes.get(joint, ()) for joint, found in places.items()}
        return tuple(Form(name, found) for name, found in (both | kept | alone).items())
