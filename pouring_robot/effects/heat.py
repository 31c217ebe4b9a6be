"""Families of effects of heat: drives and links grow. Thermometers are biased and lag; forms allow for it."""

from __future__ import annotations

import functools
from collections.abc import Callable, Collection, Mapping

import numpy as np
import pinocchio as pin

from pouring_robot.effects.base import EffectParameter, Form
from pouring_robot.effects.conditions import RISE, Conditions
from pouring_robot.effects.drives import Drives, Family, channel, of_drives
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.robot.description.definition import RobotDefinition

_PPM = 1e-6
_PRIOR_STD_PPM = 12.0
_BIAS_K = 4.0
_GAIN = 0.03
_LAG_S = 500.0
_SHORT_M = 1e-9


class DriveGrowth(Family):
    """Sliding drives are longer with their temperature, each with its own thermometer.

    Args:
        id_: as of :class:`Family`.
        story: likewise.
        drives: likewise.
        thermometers: kind of the thermometers on them.
        neighbour: thermometer at their end, if there is one.
    """

    def __init__(self, id_: str, story: str, drives: Drives, thermometers: str, neighbour: str) -> None:
        """Keep the thermometers."""
        super().__init__(id_, story, drives)
        self.neighbour, self.needs = neighbour, (f"{thermometers}{RISE}",)

    def forms(self, conditions: Conditions) -> tuple[Form, ...]:
        """Each as a whole with its thermometer, which may be biased, lag, or see another part of it."""
        thermometers = conditions.causes.drive_thermometers
        lengths = conditions.drives[:, conditions.places(self.drives)]
        rise = np.column_stack([conditions.rises[thermometers[d.joint]] for d in self.drives])
        prior_std = _PRIOR_STD_PPM

        def grown(course: FloatArray) -> dict[str, FloatArray]:
            return of_drives(self.drives, _PPM, course)

        main = EffectParameter("expansion", "1e-6/K", prior_std, grown(lengths * rise), bounds=(0.0, np.inf))
        late = lengths * (conditions.behind(rise, _LAG_S) - rise)
        shape = [
            EffectParameter("barrel", "1e-6 m/K", 0.3 * prior_std, grown(0.3 * rise), main=False),
            EffectParameter("lag", "1e-6/K", 0.7 * prior_std, grown(late), main=False),
        ]
        beside = conditions.rises.get(self.neighbour)
        if beside is not None:
            nearer = grown(lengths * (beside[:, None] - rise))
            name = f"{self.neighbour}_share"
            shape.append(EffectParameter(name, "1e-6/K", 0.2 * prior_std, nearer, main=False))
        for k, drive in enumerate(self.drives):
            where, name = channel(drive), f"{drive.symbol}_thermometer"
            bias, gain = {where: _PPM * lengths[:, k]}, {where: _PPM * lengths[:, k] * rise[:, k]}
            shape.append(EffectParameter(f"{name}_bias", "1e-6", _BIAS_K * prior_std, bias, main=False))
            shape.append(EffectParameter(f"{name}_gain", "1e-6/K", _GAIN * prior_std, gain, main=False))
        return (Form("own_temperature", (main, *shape)),)


@functools.lru_cache(maxsize=16)
def levers(robot: RobotDefinition) -> Mapping[str, tuple[str, FloatArray]]:
    """Return of every joint, fixed and moving, the link it stands on and its place there, (3,), in its own axes, in m.

    A link that grows evenly about its origin displaces the joint by this times its strain.
    """
    model = robot.mechanism().shared_model
    found: dict[str, tuple[str, FloatArray]] = {}
    for frame in model.frames:
        if frame.type not in (pin.FrameType.JOINT, pin.FrameType.FIXED_JOINT):
            continue
        link = model.frames[frame.parentFrame]
        fixed = frame.type == pin.FrameType.FIXED_JOINT
        placed = link.placement.actInv(frame.placement if fixed else model.jointPlacements[frame.parentJoint])
        found[frame.name] = link.name, np.asarray(placed.rotation.T @ placed.translation)
    return found


def _grown(
    places: Mapping[str, FloatArray], courses: Callable[[str], FloatArray], axes: str = "xyz"
) -> dict[str, FloatArray]:
    return {
        f"{joint}.t{axis}": _PPM * courses(joint) * place["xyz".index(axis)]
        for joint, place in places.items()
        for axis in axes
    }


class LinkGrowth(Family):
    """One link grows with its temperature and carries the joints on it apart.

    Args:
        id_: as of :class:`Family`.
        story: likewise.
        joints: on the link.
        thermometer: of the link.
    """

    def __init__(self, id_: str, story: str, joints: tuple[str, ...], thermometer: str) -> None:
        """Keep the thermometer."""
        super().__init__(id_, story)
        self.joints, self.thermometer, self.needs = joints, thermometer, (f"{thermometer}{RISE}",)

    def forms(self, conditions: Conditions) -> tuple[Form, ...]:
        """Evenly about its origin; perhaps less along x, with a biased thermometer, or later than its skin."""
        rise, prior_std = conditions.rises[self.thermometer], _PRIOR_STD_PPM
        known = levers(conditions.robot)
        places = {joint: known[joint][1] for joint in self.joints}
        late = conditions.behind(rise, _LAG_S) - rise
        one = np.ones(len(conditions))
        grown, along = _grown(places, lambda _: rise), _grown(places, lambda _: rise, "x")
        return (
            Form(
                "even",
                (
                    EffectParameter("expansion", "1e-6/K", prior_std, grown, bounds=(0.0, np.inf)),
                    EffectParameter("along_x", "1e-6/K", 0.3 * prior_std, along, main=False),
                    EffectParameter(
                        "thermometer_bias", "1e-6", _BIAS_K * prior_std, _grown(places, lambda _: one), main=False
                    ),
                    EffectParameter("lag", "1e-6/K", 0.7 * prior_std, _grown(places, lambda _: late), main=False),
                ),
            ),
        )


class LinksGrowth(Family):
    """All links and sliding drives grow, by any thermometer there is."""

    driven_by = "ambient_rise_k"

    def missing(self, conditions: Conditions) -> tuple[str, ...]:
        """Any thermometer will do."""
        return () if conditions.rises else ("ambient_rise_k",)

    def forms(self, conditions: Conditions) -> tuple[Form, ...]:
        """All with one thermometer, or each link with its own, which may have a share of its own; it may lag."""
        links = {name for name, _ in levers(conditions.robot).values()}
        own = [name for name in conditions.rises if name in links]
        forms = [self._form(f"by_{name}", conditions, {}, name) for name in conditions.rises]
        if own:
            forms.append(self._form("own_temperature", conditions, {name: name for name in own}, "ambient"))
        return tuple(forms)

    def _form(self, name: str, conditions: Conditions, own: Mapping[str, str], other: str) -> Form:
        """Return the form that links follow their own thermometers, and all others another one, if it is there."""
        known, prior_std = levers(conditions.robot), _PRIOR_STD_PPM
        sites = [joint for joint in conditions.causes.placements.places if known[joint][1].any()]
        of_link = {known[joint][0]: own.get(known[joint][0], other) for joint in sites}
        sites = [joint for joint in sites if of_link[known[joint][0]] in conditions.rises]
        followed = dict.fromkeys(of_link[known[joint][0]] for joint in sites)

        def changes(wanted: Collection[str], *, lagging: bool = False) -> dict[str, FloatArray]:
            rises = {thermometer: conditions.rises[thermometer] for thermometer in wanted}
            if lagging:
                rises = {name: conditions.behind(rise, _LAG_S) - rise for name, rise in rises.items()}
            places = {j: known[j][1] for j in sites if of_link[known[j][0]] in rises}
            grown = _grown(places, lambda joint: rises[of_link[known[joint][0]]])
            for k, drive in enumerate(conditions.robot.drives):
                thermometer = conditions.causes.drive_thermometers.get(drive.joint, "") if own else other
                rise = rises.get(thermometer if thermometer in followed else other)
                if drive.unit == "m" and rise is not None:
                    grown[channel(drive)] = _PPM * conditions.drives[:, k] * rise
            return grown

        shares = (
            EffectParameter(f"{name}_share", "1e-6/K", 0.3 * prior_std, changes((name,)), main=False)
            for name in (followed if len(followed) > 1 else ())
        )
        main = EffectParameter("expansion", "1e-6/K", prior_std, changes(followed), bounds=(0.0, np.inf))
        lag = EffectParameter("lag", "1e-6/K", 0.7 * prior_std, changes(followed, lagging=True), main=False)
        return Form(name, (main, lag, *shares))
