"""Families of thermal effects: drives and links grow. Thermometers are biased and lag; forms allow for this.

They use measured temperatures, also for the pouring robot; what is computed from its melt is in
:mod:`pouring_robot.thermal.expansion.leg_growth`. ``twice_lines`` of ``cli/poses/heat.py`` warns of both at once.
Which links carry what: :mod:`pouring_robot.effects.link_attachments`.
"""

import functools
import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from pouring_robot.effects.base import EffectParameter, Family, Form, channel, of_drives
from pouring_robot.effects.conditions import RISE, Conditions
from pouring_robot.effects.link_attachments import carried, chain_ends, grown_places, joint_attachments, lever
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.robot.description.drive import Drive

_Grows = Callable[[Mapping[str, FloatArray]], dict[str, FloatArray]]
_Shape = tuple[str, float, dict[str, FloatArray]]
_PPM = 1e-6
STEEL_PPM = 12.0  # per kelvin
_BIAS_K = 4.0
_OWN = 0.3  # share by which the growth of a part may differ from the others': another steel, another heated length
_LAGS_S = (150.0, 600.0, 2400.0)
"""Time constants with which a part lags its thermometer, from thin to thick: their sums represent all between."""


def _lags_s(conditions: Conditions) -> tuple[float, ...]:
    """Return the time constants that rows can show: without times, the order of rows is no time in seconds."""
    timed = conditions.learned.timed if conditions.learned else conditions.time_known
    return _LAGS_S if timed else ()


def _late(conditions: Conditions, rise: FloatArray) -> Iterator[tuple[str, FloatArray]]:
    """Yield by how much lagging parts are warmer than their thermometers, with a name each."""
    for lag_s in _lags_s(conditions):
        yield f"lag_{lag_s:.0f}_s", conditions.behind(rise, lag_s) - rise


@dataclass(eq=False, kw_only=True)
class DriveGrowth(Family):
    """Sliding drives expand with their temperature, each with its own thermometer."""

    thermometers: str  # kind of the thermometers on them
    neighbour: str  # thermometer at their end, if there is one

    def __post_init__(self) -> None:
        self.needs, self.shaped_by = (f"{self.thermometers}{RISE}",), (f"{self.neighbour}{RISE}",)

    def forms(self, conditions: Conditions) -> tuple[Form, ...]:
        """The whole length, or a rod of constant length; thermometers may be biased, lag, or measure another part."""
        lengths = conditions.spans[:, conditions.places(self.drives)]
        usual = conditions.mean_span_m[conditions.places(self.drives)].mean()
        whole, rod = lengths, np.full_like(lengths, usual)
        return (
            Form("own_temperature", self._parameters(conditions, whole, rod)),
            Form("own_length", self._parameters(conditions, rod, whole)),
        )

    def _parameters(self, conditions: Conditions, length: FloatArray, other: FloatArray) -> tuple[EffectParameter, ...]:
        """Return the parameters for a heated ``length``, (n, D), of each drive, perhaps with a share of another one."""
        std, thermometers = STEEL_PPM, conditions.causes.drive_thermometers
        rise = np.column_stack([conditions.rises[thermometers[d.joint]] for d in self.drives])

        shapes = [("other_length", 1.0, other * rise)]
        shapes += [(name, 0.7, length * course) for name, course in _late(conditions, rise)]
        neighbour = conditions.rises.get(self.neighbour)
        if neighbour is not None:
            shapes.append((f"{self.neighbour}_share", 0.2, length * (neighbour[:, None] - rise)))
        changes = functools.partial(of_drives, self.drives, _PPM)
        found = [EffectParameter("expansion", "1e-6/K", std, changes(length * rise), bounds=(0.0, np.inf))]
        found += [EffectParameter(n, "1e-6/K", size * std, changes(course), main=False) for n, size, course in shapes]
        for k, drive in enumerate(self.drives):
            where, name = channel(drive), f"{drive.symbol}_thermometer"
            bias, gain = {where: _PPM * length[:, k]}, {where: _PPM * length[:, k] * rise[:, k]}
            found.append(EffectParameter(f"{name}_bias", "1e-6", _BIAS_K * std, bias, main=False))
            found.append(EffectParameter(f"{name}_gain", "1e-6/K", _OWN * std, gain, main=False))
        return tuple(found)


def _grown(places: Mapping[str, FloatArray], course: FloatArray) -> dict[str, FloatArray]:
    """Return the displacements by a growth (n,), in 1e-6, of joints by their places on it, (3,) or (3, n), in m."""
    return {
        f"{joint}.t{axis}": _PPM * course * along
        for joint, place in places.items()
        for axis, along in zip("xyz", place, strict=True)
    }


@dataclass(eq=False, kw_only=True)
class LinkGrowth(Family):
    """One link expands with its temperature and moves the joints on it apart."""

    joints: tuple[str, ...]  # on the link
    thermometer: str  # of the link

    def __post_init__(self) -> None:
        self.needs = (f"{self.thermometer}{RISE}",)

    def forms(self, conditions: Conditions) -> tuple[Form, ...]:
        """Uniform about its origin; single joints may deviate, the thermometer be biased, the link lag its surface."""
        rise, std, known = conditions.rises[self.thermometer], STEEL_PPM, joint_attachments(conditions.robot)
        places = {joint: lever(known[joint][1]) for joint in self.joints}
        size = _OWN * std * float(np.sqrt(np.mean([place**2 for place in places.values()])))

        shapes = [("thermometer_bias", "1e-6", _BIAS_K * std, _grown(places, np.ones(len(conditions))))]
        shapes += [(name, "1e-6/K", 0.7 * std, _grown(places, late)) for name, late in _late(conditions, rise)]
        sites = itertools.product(places, "xyz")
        shapes += [(f"{j}_{axis}", "1e-6 m/K", size, {f"{j}.t{axis}": _PPM * rise}) for j, axis in sites]
        main = EffectParameter("expansion", "1e-6/K", std, _grown(places, rise), bounds=(0.0, np.inf))
        return (Form("even", (main, *(EffectParameter(*shape, main=False) for shape in shapes))),)


class LinksGrowth(Family):
    """All links and sliding drives expand, by whatever thermometers there are."""

    driven_by, substitute = "ambient_rise_k", "<link>_degC of any link"

    def missing(self, conditions: Conditions) -> tuple[str, ...]:
        """Any thermometer will do."""
        return () if conditions.rises else ("ambient_rise_k",)

    def forms(self, conditions: Conditions) -> tuple[Form, ...]:
        """All parts by one thermometer, or each by its own, perhaps with a share of its own; parts may lag."""
        parts = {name for name, _ in joint_attachments(conditions.robot).values()}
        parts |= {name for name, drives in conditions.robot.groups.items() if drives[0].unit == "m"}
        own = [name for name in conditions.rises if name in parts]
        ways: dict[str, tuple[Sequence[str], str]] = {f"by_{name}": ((), name) for name in conditions.rises}
        if own:
            ways["own_temperature"] = (own, "ambient")
        return tuple(itertools.chain.from_iterable(self._forms(name, conditions, *way) for name, way in ways.items()))

    def _forms(self, name: str, conditions: Conditions, own: Sequence[str], other: str) -> Iterator[Form]:
        """Yield the forms in which parts follow their ``own`` thermometers, and all others the ``other``, if it exists.

        What measures a slide's travel, a screw or a glass scale, grows like the frame, not at all, or alone (by its own
        friction, or in a granite frame). No file states where it is held, from where on it grows.
        """
        prior_std, robot = STEEL_PPM, conditions.robot
        places = robot.drawing().engine.structure.placed_joints  # all that affect the pose, also those made as drawn
        moved = grown_places(robot, places) + chain_ends(robot, places)
        # A shift of the end frame alone equals one of the base; a shift of the base frame, the opposite one.
        moved += [("base", link, -place) for link, place in carried(robot, robot.loops.base_frame, places)]
        behind = carried(robot, robot.loops.end_frame, places) if robot.loops.end_frame else ()
        moved += [("base", link, (conditions.rotation @ place).T) for link, place in behind]
        moved = [(joint, link if link in own else other, place) for joint, link, place in moved if place.any()]
        slid = [
            (drive, next((part for part in _parts_of(drive, conditions) if part in own), other), travel)
            for drive, travel in zip(robot.drives, conditions.drives.T, strict=True)
            if drive.unit == "m"
        ]
        used = {by for _, by, _ in (*moved, *slid)}
        followed = {by: rise for by, rise in conditions.rises.items() if by in used}

        def frame(rises: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
            grown: dict[str, FloatArray] = {}
            for joint, by, place in moved:
                if by in rises:
                    for site, change in _grown({joint: place}, rises[by]).items():
                        grown[site] = grown.get(site, 0.0) + change
            return grown

        def slides(rises: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
            return {channel(drive): _PPM * travel * rises[by] for drive, by, travel in slid if by in rises}

        lags_s = _lags_s(conditions)
        late = [(t, {by: conditions.behind(rise, t) - rise for by, rise in followed.items()}) for t in lags_s]
        ends = {drive: {channel(drive): _PPM * followed[by]} for drive, by, _ in slid if by in followed}
        held = [EffectParameter(f"{d.symbol}_metre", "1e-6/K", prior_std, change) for d, change in ends.items()]
        scales, links = ("drives_share", 0.3, slides(followed)), ("frame_share", 0.3, frame(followed))
        ways: dict[str, tuple[_Grows, _Shape, list[EffectParameter]]]
        ways = {"": (lambda rises: frame(rises) | slides(rises), scales, held)}
        if ends:
            ways |= {"_frame_alone": (frame, scales, []), "_drives_alone": (slides, links, held)}
        for which, (changes, share, more) in ways.items():
            shapes = [(f"lag_{lag_s:.0f}_s", 0.7, changes(rises)) for lag_s, rises in late]
            if len(followed) > 1:
                shapes += [(f"{by}_share", 0.3, changes({by: rise})) for by, rise in followed.items()]
            main = EffectParameter("expansion", "1e-6/K", prior_std, changes(followed), bounds=(0.0, np.inf))
            shaped = [(n, "1e-6/K", s * prior_std, c) for n, s, c in (*shapes, share) if c]
            if main.changes or not which:
                yield Form(f"{name}{which}", (main, *more, *(EffectParameter(*one, main=False) for one in shaped)))


def _parts_of(drive: Drive, conditions: Conditions) -> tuple[str, ...]:
    """Return the parts whose thermometers may measure a slide's screw or scale: its groups, then its link."""
    groups = (group for group, drives in conditions.robot.groups.items() if drive in drives)
    return (*groups, conditions.causes.drive_thermometers.get(drive.joint, ""))
