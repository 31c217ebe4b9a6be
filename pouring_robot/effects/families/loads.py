"""Families of effects of weight: sliding drives stretch, turning drives yield, joints tilt, a beam sinks and rolls."""

import functools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.polynomial.legendre import legvander

from pouring_robot.effects.base import EffectParameter, Family, Form, channel, of_drive, of_drives
from pouring_robot.effects.conditions import FORCE, Conditions
from pouring_robot.io.units import MM, MRAD
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.weight_on_joints import up_in_base
from pouring_robot.robot.description.definition import RobotDefinition

_LATER = 0.2
_LEAST = 1e-4  # share of the usual force, or of a newton carried, below which the force on a drive counts as none
_ROUND_OFF = 1e-12  # component of a direction along an axis below which it counts as none
_UPRIGHT = 1e-3  # sine of the angle to the vertical below which a travel counts as vertical
_OWN = 0.5  # by how much more compliant one drive may be than the others
_ORDERS = 6  # of a beam's deflection under a load that moves along it: x^3 (1 - x)^3 where its ends are built in


def _at(load: float, unit: str) -> str:
    """Return in words at which load a size is stated."""
    return f"at {load / 1e3:g} k{unit}" if load >= 1e3 else f"at {load:g} {unit}"


def _hertzian(load: FloatArray) -> FloatArray:
    """Return how contacts of balls or teeth yield: by the load to the power 2/3."""
    return np.asarray(np.sign(load) * np.abs(load) ** (2.0 / 3.0))


def _along(what: str, direction: FloatArray, course: FloatArray) -> dict[str, FloatArray]:
    """Return by how much a joint or the base is shifted (``.t``) or turned (``.r``) along a direction in it, (3,)."""
    shares = zip("xyz", direction.tolist(), strict=True)
    return {f"{what}{axis}": share * course for axis, share in shares if abs(share) > _ROUND_OFF}


@functools.lru_cache(maxsize=16)
def _level(robot: RobotDefinition, travel: str) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the directions up, horizontal across a travel, and horizontal along it, in base axes, (3,) each.

    For a vertical travel, which directions are across and along is a convention.
    """
    mechanism = robot.mechanism()
    up, ways = up_in_base(mechanism), [*np.eye(3)[[1, 2, 0]]]
    if travel in mechanism.joint_columns:
        joint = mechanism.joint_id(travel)
        frames = mechanism.frames_at(mechanism.neutral_configuration())
        base = frames.oMf[mechanism.frame_id(mechanism.loops.base_frame)].rotation
        ways.insert(0, base.T @ frames.oMi[joint].rotation @ mechanism.joint_axes([joint])[0, :3])
    across = next(level for way in ways if np.linalg.norm(level := np.cross(way, up)) > _UPRIGHT)
    across /= np.linalg.norm(across)
    return up, across, np.cross(up, across)


@dataclass(eq=False, kw_only=True)
class _Yielding(Family):
    """Drives of a group yield under the forces that weight puts on them."""

    group: str  # of the drives
    load: float  # at which the yield is stated, in N or Nm

    def __post_init__(self) -> None:
        self.needs = (f"{self.group}{FORCE}",)

    def can_occur(self, conditions: Conditions) -> bool:
        """Whether weight loads any of them: the robot's own, or that of what it carries or might carry.

        A vertical axis of a drive, or a horizontal slide, is so only within the rounding of a drawing.
        """
        parts = ((conditions.drive_force, self.load), (conditions.force_by_weight, 1.0))
        places = conditions.places(self.drives)
        return any(part is not None and np.abs(part[:, places]).max() > _LEAST * size for part, size in parts)


@dataclass(eq=False, kw_only=True)
class AxialCompliance(_Yielding):
    """Sliding drives stretch under the force along them."""

    length_m: float  # of a rod for which the stretch is stated

    def forms(self, conditions: Conditions) -> tuple[Form, ...]:
        """Rods (by force and length), nuts and bearings (by force), ball contacts (by the force to the power 2/3)."""
        places = conditions.places(self.drives)
        pull = np.asarray(conditions.drive_force)[:, places] / self.load
        rod = pull * np.abs(conditions.spans[:, places]) / self.length_m  # whichever way from zero it extends
        at, changes = f" {_at(self.load, 'N')}", functools.partial(of_drives, self.drives, MM)
        stiffening = EffectParameter("stiffening", f"mm{at}", _LATER, changes(pull * np.abs(pull)), main=False)
        share = EffectParameter("rod_share", f"mm{at}", 0.3, changes(rod - pull), main=False)
        found = []
        for name, course in {"rod": rod, "nut": pull, "contact": _hertzian(pull)}.items():
            main = EffectParameter("stretch", f"mm{at}", 1.0, changes(course), bounds=(0.0, np.inf))
            each = zip(self.drives, course.T, strict=True)
            own = (of_drive(d, "difference", _OWN, c, main=False, per=at) for d, c in each)
            found.append(Form(name, (main, stiffening, share, *own)))
        return tuple(found)


@dataclass(eq=False, kw_only=True)
class TorsionalCompliance(_Yielding):
    """Turning drives yield to the moment on them."""

    # rated moment of each drive, in Nm; by default all alike. Gears of similar shape and material under the same stress
    # wind up by the same angle: one rated for less is more compliant in proportion. Their geometric mean is 1.
    strengths: Sequence[float] = ()

    def __post_init__(self) -> None:
        super().__post_init__()
        strong = np.array(self.strengths) if self.strengths else np.ones(len(self.drives))
        self.sizes = (np.exp(np.log(strong).mean()) / strong).tolist()

    def forms(self, conditions: Conditions) -> tuple[Form, ...]:
        """In proportion to the moment, or to its power 2/3 (contacts of teeth); perhaps stiffening or softening."""
        moments = np.asarray(conditions.drive_force)[:, conditions.places(self.drives)] / self.load
        unit = f"mrad {_at(self.load, 'Nm')}"
        courses = {"spring": moments, "contact": _hertzian(moments)}
        later = {"cubic": moments**3, "quadratic": moments * np.abs(moments)}
        found = []
        for form, course in courses.items():
            main, shape = [], []
            for k, drive in enumerate(self.drives):
                name, where = f"{drive.symbol}_" if len(self.drives) > 1 else "", channel(drive)
                changes, size = {where: MRAD * course[:, k]}, self.sizes[k]
                main.append(EffectParameter(f"{name}yield", unit, size, changes, bounds=(0.0, np.inf)))
                others = later | {n: c for n, c in courses.items() if n != form}
                for word, other in others.items():
                    changes = {where: MRAD * other[:, k]}
                    shape.append(EffectParameter(f"{name}{word}", unit, _LATER * size, changes, main=False))
            found.append(Form(form, (*main, *shape)))
        return tuple(found)


@dataclass(eq=False, kw_only=True)
class BearingCompliance(Family):
    """Joints of an open chain tilt under the moment of what they carry: their bearings and the links that hold them.

    A sliding joint is a beam that is extended: how far it tilts also depends on its extension.
    """

    load: float  # moment at which tilts are stated, in Nm
    tilts: Mapping[str, Mapping[str, Sequence[float]]]  # joint → about what it may tilt: directions in its placement
    sizes: Mapping[str, float]  # joint → its expected compliance relative to the others
    strokes: Mapping[str, tuple[float, float]]  # sliding joint → middle and half of its stroke, in m
    needs = ("joint_moments",)
    shaped_by = ("weight_n",)

    def can_occur(self, conditions: Conditions) -> bool:
        """Whether what joints carry has a moment across their axes, beyond the rounding of a drawing."""
        about = (self._moment(conditions, joint, way) for joint, ways in self.tilts.items() for way in ways.values())
        return any(np.abs(moment).max() > _LEAST * self.load for moment in about)

    def forms(self, conditions: Conditions) -> tuple[Form, ...]:
        """All joints, or one of them."""
        by_joint = {joint: tuple(self._of_joint(joint, conditions)) for joint in self.tilts}
        alone = {f"{joint}_alone": found for joint, found in by_joint.items() if len(by_joint) > 1}
        every = tuple(p for found in by_joint.values() for p in found)
        return tuple(Form(name, found) for name, found in {"all": every, **alone}.items())

    @staticmethod
    def _moment(conditions: Conditions, joint: str, way: Sequence[float]) -> FloatArray:
        """Return the moment on a joint about a direction in its placement, (n,), in Nm; 0 where it is not known."""
        moments = conditions.joint_moments or {}
        shares = (share * moments.get(f"{joint}.r{axis}", 0.0) for axis, share in zip("xyz", way, strict=True) if share)
        return np.asarray(sum(shares))

    def _of_joint(self, joint: str, conditions: Conditions) -> Iterator[EffectParameter]:
        """Yield the tilts of a joint; one about an axis without a moment in these rows is zero.

        How a slide's tilt grows with its extension is as much a main parameter as the tilt itself: a beam that is free
        over twice the length tilts several times as far.
        """
        unit, size = f"mrad {_at(self.load, 'Nm')}", self.sizes[joint]
        for called, way in self.tilts[joint].items():
            name, moment = f"{joint}.yield_{called}", self._moment(conditions, joint, way) / self.load
            turned = functools.partial(_along, f"{joint}.r", np.array(way))
            yield EffectParameter(name, unit, size, turned(MRAD * moment), bounds=(0.0, np.inf))
            if joint in self.strokes:
                middle, half = self.strokes[joint]
                out = (conditions.slides_m[joint] - middle) / half
                for word, share, course in (("by_stroke", 1.0, out), ("by_stroke_squared", 0.5, out**2)):
                    yield EffectParameter(f"{name}_{word}", unit, share * size, turned(MRAD * moment * course))


@dataclass(eq=False, kw_only=True)
class BeamDeflection(Family):
    """The base sinks and rolls with its position along a beam, and with the load."""

    travel: str  # condition that states this position
    weight_n: float  # load at which deflections are stated

    def __post_init__(self) -> None:
        self.needs, self.driven_by = ("weight_n", self.travel, "truss_span_m"), self.travel

    def forms(self, conditions: Conditions) -> tuple[Form, ...]:
        """A moving load on two posts, a uniform load or half a sine, perhaps with torsion and dead load; or any line.

        Any line is a polynomial of the position, for sinking, roll and pitch each: rails that yield differently. What
        leans with a slope turns about the horizontal direction across the beam.
        """
        up, across, along = _level(conditions.robot, self.travel.removesuffix("_m"))
        span = float(conditions.truss_span_m or np.nan)
        x = np.asarray(conditions.value(self.travel)) / span
        lines = {
            "moving_load": (16.0 * (x * (1.0 - x)) ** 2, 32.0 * x * (1.0 - x) * (1.0 - 2.0 * x) / span),
            "even_load": (3.2 * x * (1.0 - x) * (1.0 + x - x**2), 3.2 * (1.0 - 6.0 * x**2 + 4.0 * x**3) / span),
            "half_sine": (np.sin(np.pi * x), np.pi / span * np.cos(np.pi * x)),
        }
        load, at = np.asarray(conditions.weight_n) / self.weight_n, _at(self.weight_n, "N")
        found = []
        for name, (sink, slope) in lines.items():
            courses = (
                ("sink", "mm", 1.0, _along("base.t", up, -MM * sink), True),
                ("lean", "mrad m/mm", 1.0, _along("base.r", across, MRAD * slope), True),
                ("torsion", "mrad", 0.5, _along("base.r", across, MRAD * sink), False),
            )
            parameters = [
                EffectParameter(
                    f"{dead}{label}",
                    unit + per,
                    share * prior_std,
                    {moved: course * weighed for moved, course in moves.items()},
                    main and not dead,
                )
                for dead, per, share, weighed in (("", f" {at}", 1.0, load), ("dead_", "", 0.3, 1.0))
                for label, unit, prior_std, moves, main in courses
            ]
            found.append(Form(name, tuple(parameters)))
        line = legvander(2.0 * x - 1.0, _ORDERS).T
        turns = ("roll", "mrad", "base.r", MRAD * across), ("pitch", "mrad", "base.r", MRAD * along)
        free = [
            EffectParameter(f"{name}{way}_{order}", f"{unit} {at}", 1.0 / (1 + order), _along(what, to, course), main)
            for name, main, weighed in (("", True, line * load), ("dead_", False, line))
            for way, unit, what, to in (("sink", "mm", "base.t", -MM * up), *turns)
            for order, course in enumerate(weighed)
        ]
        return (*found, Form("any_line", tuple(free)))
