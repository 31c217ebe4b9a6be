"""Families of effects of drives: zeros, scales, coupling, errors that repeat with every turn, backlash."""

import functools
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from pouring_robot.effects.base import EffectParameter, Family, Form, of_drive, of_each
from pouring_robot.effects.conditions import SIDES, Conditions
from pouring_robot.estimation.intervals import Z95, value_and_half_width
from pouring_robot.io.units import MM, MRAD, shown_in
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.robot.description.drive import Drive

_SHOWN_ORDERS = 3
_FINE, _SMALL = 1e-4, 1e-3
_GEAR = 10.0
"""In mrad/rad, of a gear ratio or a coupling by gears: one tooth of a hundred, as a strain-wave gear of 100 to 1 turns
101 to one on its other spline."""
_WAVES = (("sine", np.sin), ("cosine", np.cos))
_ONCE, _OVAL = "_once", 2  # a form of one joint, up to this order

_PRESSED = "pressed_from_"
_PRESSING = tuple(float(f"{10.0 ** (k / 40.0):.3g}") for k in range(-20, 21))
"""Forces that overcome a nut's friction, relative to the usual one: a third to three, by R40 of preferred numbers."""
_NO_FORCE = 1e-9  # N, Nm: round-off in the force on a drive that carries nothing, such as one about the vertical


@dataclass(eq=False)
class ZeroOffset(Family):
    """Constant error of drives."""

    driven_by: str = "position_m"  # condition that must vary for it to be observable
    size: float = 1.0  # usual one, in mm or mrad
    _HOMING = 0.02

    def forms(self, conditions: Conditions) -> tuple[Form, ...]:
        """All drives, or one alone; homing may scatter between sessions by a fiftieth of the usual size."""
        sessions = len(conditions.session_shares)
        homing = [
            of_drive(d, f"homing_session_{s + 1}", self._HOMING * self.size, conditions.in_session(s), main=False)
            for d in self.drives
            for s in range(sessions if sessions > 1 else 0)
        ]
        offsets = of_each(conditions, self.drives, "offset", self.size, np.ones(conditions.drives.shape))
        forms = [Form("all", tuple(offsets))]
        if len(offsets) > 1:
            forms += [Form(f"{d.symbol}_alone", (offset,)) for d, offset in zip(self.drives, offsets, strict=True)]
        if homing:
            forms += [Form(f"{form.name}_homed", (*form.parameters, *homing)) for form in forms]
        return tuple(forms)


@dataclass(eq=False)
class DriveScale(Family):
    """Error in proportion to the stroke of sliding drives: a wrong lead or gear ratio; perhaps with a build-up."""

    middle_m: float = 0.0  # of the stroke; 0: it counts from zero, and there are no forms from a home
    half_stroke_m: float = 1.0  # to either side
    # whether a lead that changes along the stroke is a main parameter, too, as on a spool whose line lies in layers; if
    # not, it only shapes the effect
    build_up: bool = False
    driven_by = "lengths_m"

    def in_words(self, values: Mapping[str, float], stds: Mapping[str, float]) -> tuple[str, ...]:
        """For leads that change along the stroke: each drive's error of lead at zero, and how it changes."""
        if not self.build_up:
            return ()
        lines = []
        for drive in self.drives:
            names = ((1.0, f"{drive.symbol}_scale"), (2.0, f"{drive.symbol}_progression"))
            if not any(name in values for _, name in names):  # a form of another drive alone
                continue
            # Relative, each with its standard deviation; the lead is the derivative of the error by the length.
            lead, more = (MM * k * np.array([known.get(n, 0.0) for known in (values, stds)]) for k, n in names)
            per, unit = (1e6, "ppm") if Z95 * lead[1] < _FINE else (100.0, "%")
            line = f"{drive.words}: lead error {_with95(per * lead, unit)} at zero"
            line += f", {_with95(per * more, unit)} more per metre"
            if turn := drive.per_turn:
                a_turn, change = turn / MM * (lead + np.array([1.0, 0.0])), turn / MM * more
                each_turn = _with95(a_turn, "mm").removeprefix("+")
                line += f"; that is {each_turn} per turn, {_with95(change, 'mm')} more per metre"
            lines.append(f"{line} (95 %)")
        return tuple(lines)

    def forms(self, conditions: Conditions) -> tuple[Form, ...]:
        """In proportion to the length, or to the stroke from the home; the lead may change along it.

        Of all drives, or by length of one alone.

        Lengths count from the controller's zero. Homes are in the middle or at an end of the stroke, or near there.
        """
        lengths = conditions.from_zero
        # A spool has its nominal lead where its count is zero; a worn screw has it on average over its stroke.
        mean = 0.0 if self.build_up else self.half_stroke_m**2 / 3.0
        bent, size = (lengths - self.middle_m) ** 2 - mean, 1.0 if self.build_up else 0.5
        each = functools.partial(of_each, conditions, self.drives)
        lead = each("scale", 1.0, lengths, per="/m")
        progressive = each("progression", size, bent, main=self.build_up, per="/m²")
        found = [Form("whole_length", (*lead, *progressive))]
        if len(lead) > 1:
            alone = zip(self.drives, zip(lead, progressive, strict=True), strict=True)
            found += [Form(f"{drive.symbol}_alone", parameters) for drive, parameters in alone]
        if self.middle_m:
            home = each("home", self.middle_m, np.ones(lengths.shape), main=False)
            for name, ends in (("from_home", 0.0), ("from_retracted", -1.0), ("from_extended", 1.0)):
                stroke = lengths - (self.middle_m + ends * self.half_stroke_m)
                found.append(Form(name, (*each("scale", 1.0, stroke, per="/m"), *home, *progressive)))
        return tuple(found)


@dataclass(eq=False)
class Ratio(Family):
    """Error in proportion to the angle of turning drives: a wrong gear ratio or count per turn."""

    driven_by = "angles_rad"

    def in_words(self, values: Mapping[str, float], stds: Mapping[str, float]) -> tuple[str, ...]:
        """By what share each drive turns further than commanded, and by how much its zero is then off."""
        lines = []
        for drive in self.drives:
            if (name := f"{drive.symbol}_scale") in values:  # not in a form of another drive alone
                share, std = MRAD * values[name], MRAD * stds.get(name, 0.0)
                per, unit = (1e6, "ppm") if max(abs(share), Z95 * std) < _SMALL else (100.0, "%")
                further = _with95(per * np.array([share, std]), unit)
                line = f"{drive.words}: it turns {further} further than commanded"
                if (home := f"{drive.symbol}_home") in values:
                    off = _with95(np.array([values[home], stds.get(home, 0.0)]), "mrad")
                    line += f", and is {off} off at count zero"
                lines.append(f"{line} (95 %)")
        return tuple(lines)

    def forms(self, conditions: Conditions) -> tuple[Form, ...]:
        """In proportion to the angle from where the count is zero, or from the home; of all drives, or of one alone.

        If a drive was homed a radian from zero, a wrong ratio leaves as much of an offset as it adds in a radian.
        """
        angles = conditions.from_zero
        scale = of_each(conditions, self.drives, "scale", _GEAR, angles, per="/rad")
        home = of_each(conditions, self.drives, "home", _GEAR, np.ones(angles.shape), main=False)
        forms = [Form("all", tuple(scale)), Form("all_from_home", (*scale, *home))]
        for drive, *each in zip(self.drives, scale, home, strict=True) if len(scale) > 1 else ():
            forms += [Form(f"{drive.symbol}_alone", (each[0],)), Form(f"{drive.symbol}_from_home", tuple(each))]
        return tuple(forms)


@dataclass(eq=False)
class Coupling(Family):
    """A turning drive moves in proportion to another one: its shafts, belts or rods pass the other's joint."""

    driven_by = "angles_rad"
    _PAST = 2  # joints that are passed: a hollow wrist has all its three motors behind it

    def forms(self, conditions: Conditions) -> tuple[Form, ...]:
        """One drive by one before it, counted from that one's zero; or two neighbours by each other."""
        turned = conditions.from_zero[:, conditions.places(self.drives)].T

        def along(k: int, other: int) -> EffectParameter:
            name = f"by_{self.drives[other].symbol}"
            return of_drive(self.drives[k], name, _GEAR, turned[other], per="/rad")

        forms = []
        for k, drive in enumerate(self.drives):
            for other in range(max(k - self._PAST, 0), k):
                forms.append(Form(f"{drive.symbol}_by_{self.drives[other].symbol}", (along(k, other),)))
            if k:
                both = (along(k, k - 1), along(k - 1, k))
                forms.append(Form(f"{self.drives[k - 1].symbol}_and_{drive.symbol}", both))
        return tuple(forms)


def _with95(found: FloatArray, unit: str) -> str:
    """Return a normal value and its standard deviation, (2,), as text with the 95 % half width."""
    value, half = value_and_half_width(float(found[0]), abs(float(found[1])), math.inf)
    return f"{value} ± {half} {unit}"


@dataclass(eq=False, kw_only=True)
class Periodic(Family):
    """Error of drives that is periodic in their own position."""

    sizes: Sequence[float] = (1.0, 0.25, 0.1)  # usual size of each order over the first; by default of a screw
    # ``turn`` of the joint; ``pitch``: travel of a sliding drive per turn of the motor, by the robot file or the
    # campaign's screw pitch; or ``screw_pitch_m``: the campaign's
    period: str = "turn"
    all_main: bool = False  # whether every order is a main parameter; if not, higher ones only shape the first

    def __post_init__(self) -> None:
        self.periodic = self.period == "turn"
        stated = tuple(drive for drive in self.drives if drive.per_turn) if self.period == "pitch" else ()
        if self.periodic:
            self.driven_by = "angles_rad"
        elif stated:
            # A drive without a stated lead has no screw, such as a linear motor among screws.
            self.drives, self.driven_by = stated, "lengths_m"
        else:
            self.needs = ("screw_pitch_m",)

    def _learned(self, conditions: Conditions, drives: Sequence[Drive], orders: int) -> list[FloatArray]:
        if not self.periodic:
            return [np.ones(len(conditions)) for _ in drives]
        return [conditions.learned_share(drive, 2.0 * np.pi / orders) for drive in drives]

    def rows_not_learned(self, conditions: Conditions, form: str) -> Mapping[str, int]:
        """For harmonics of a joint's turn: rows at angles far from all measured ones."""
        alone = [drive for drive in self.drives if form == drive.symbol + _ONCE]
        drives, orders = (alone, _OVAL) if alone else (self.drives, len(self.sizes))
        learned = zip(drives, self._learned(conditions, drives, orders), strict=True)
        counts = {drive.words: int((known == 0.0).sum()) for drive, known in learned}
        return {words: count for words, count in counts.items() if count}

    def in_words(self, values: Mapping[str, float], stds: Mapping[str, float]) -> tuple[str, ...]:
        """For many orders: how large the error of each drive is, and which orders are the largest."""
        if not self.all_main:
            return ()
        lines = []
        symbols = {name.rsplit("_", 2)[0] for name in values}
        for drive in (d for d in self.drives if d.symbol in symbols):  # not in a form of another drive alone
            orders = range(1, len(self.sizes) + 1)
            waves = [[values.get(f"{drive.symbol}_{name}_{order}", 0.0) for order in orders] for name, _ in _WAVES]
            sizes = np.hypot(*np.array(waves))
            largest = [int(k) for k in np.argsort(-sizes)[:_SHOWN_ORDERS] if sizes[k] > 0.0]
            unit, _ = shown_in(drive.unit)
            said = ", ".join(f"{k + 1} ({sizes[k]:.3f})" for k in largest)
            rms = float(np.sqrt((sizes**2).sum() / 2.0))
            lines.append(f"{drive.words}: {rms:.3f} {unit} rms over a turn; largest orders (amplitude): {said}")
        return tuple(lines)

    def forms(self, conditions: Conditions) -> tuple[Form, ...]:
        """Once per turn, with overtones; on a screw perhaps larger towards one end of it.

        For a joint's turn also one joint alone: an eccentric disc makes the first order, which the second one shapes if
        the disc is also oval. What was learned in another campaign counts only at angles measured there.
        """
        columns = conditions.places(self.drives)
        values = conditions.drives[:, columns].T
        phases = [d.turned(value, conditions.screw_pitch_m) for d, value in zip(self.drives, values, strict=True)]

        def waves(orders: int, main: int) -> list[EffectParameter]:
            learned = self._learned(conditions, self.drives, orders)
            return [
                of_drive(d, f"{name}_{order}", size, known * wave(order * phase), main=order <= main)
                for order, size in enumerate(self.sizes[:orders], 1)
                for d, phase, known in zip(self.drives, phases, learned, strict=True)
                for name, wave in _WAVES
            ]

        parameters = waves(len(self.sizes), len(self.sizes) if self.all_main else 1)
        if not self.periodic:  # a bent screw wobbles more the farther its nut is from the bearings
            usual = conditions.mean_span_m[columns]
            along = conditions.spans[:, columns] / np.where(usual == 0.0, 1.0, usual) - 1.0
            parameters += [
                of_drive(d, f"{name}_1_by_length", self.sizes[0], wave(phase) * along[:, k], main=False)
                for k, (d, phase) in enumerate(zip(self.drives, phases, strict=True))
                for name, wave in _WAVES
            ]
        forms = [Form("turns", tuple(parameters), series=self.all_main)]
        if self.all_main:
            once = waves(_OVAL, 1)
            for k, drive in enumerate(self.drives):
                first, oval = (once[2 * j :][:2] for j in (k, k + len(self.drives)))
                forms.append(Form(drive.symbol + _ONCE, (*first, *oval)))
        return tuple(forms)


@dataclass(eq=False)
class Backlash(Family):
    """Backlash (lost motion), by the side a drive was approached from."""

    middle_m: float = 0.0  # of the stroke of sliding drives
    half_stroke_m: float = 1.0  # to either side
    group: str = ""  # of the drives, where there are several
    shaped_by = ("weight_n",)
    _LOADED, _LATER, _WORN = 0.3, 0.1, 0.1

    def __post_init__(self) -> None:
        self.needs = (f"{self.group}{SIDES}" if self.group else "approach",)

    def _with_side(self, conditions: Conditions) -> tuple[Drive, ...]:
        """Return the drives whose side of approach is known."""
        if conditions.approach is None:
            return ()
        places = zip(self.drives, conditions.places(self.drives), strict=True)
        return tuple(drive for drive, k in places if conditions.approach[:, k].any())

    def missing(self, conditions: Conditions) -> tuple[str, ...]:
        """As for every effect; also where no drive's side of approach is known."""
        return super().missing(conditions) or (() if self._with_side(conditions) else self.needs)

    def forms(self, conditions: Conditions) -> tuple[Form, ...]:
        """Symmetrical, or on one side only; load may take up part of it, and wear may increase it along the stroke.

        With free play (``pressed``) the nut lies on the flank that the force presses it to, where friction does not
        hold it.
        """
        side, drives, loaded = np.asarray(conditions.approach), self._with_side(conditions), _loaded(conditions)
        sliding = tuple(d for d in drives if d.unit == "m")
        stroke = (conditions.drives - self.middle_m) / self.half_stroke_m
        shapes = [(sliding, "play_by_length", self._WORN, stroke), (sliding, "play_by_length_2", self._WORN, stroke**2)]
        if loaded:
            carried = conditions.mean_force
            relative = np.abs(np.asarray(conditions.drive_force)) / np.maximum(carried, _NO_FORCE) - 1.0
            places = zip(drives, conditions.places(drives), strict=True)
            # for a drive that carries nothing they would duplicate its play, and split its size among the names
            carrying = tuple(drive for drive, k in places if carried[k] > _NO_FORCE)
            shapes += [
                (carrying, "play_by_load", self._LOADED, relative),
                (carrying, "play_by_load_2", self._LATER, relative**2),
            ]
        found = []
        ways = {"both_sides": side, "rising_only": 0.5 * (side + 1.0), "falling_only": 0.5 * (side - 1.0)}
        for form, sides in ways.items():
            parameters = of_each(conditions, drives, "play", 1.0, sides)
            for some, name, prior_std, course in shapes:
                parameters += of_each(conditions, some, name, prior_std, sides * course, main=False)
            found.append(Form(form, tuple(parameters)))
        return (*found, *(self._pressed(conditions, share) for share in (_PRESSING if loaded else ())))

    def form(self, name: str, conditions: Conditions) -> Form:
        """As for every effect; but the force of a ``pressed`` form may be any, not only those searched."""
        share = re.fullmatch(_PRESSED + r"(\d*\.?\d+)", name)
        if share and _loaded(conditions):
            return self._pressed(conditions, float(share[1]))
        return super().form(name, conditions)

    def _pressed(self, conditions: Conditions, share: float) -> Form:
        """Return free play on the flank that the force determines where it exceeds a share of the usual one.

        The usual force is the mean over drives of the same unit: similar nuts have similar friction. Below that share,
        the nut lies where friction drags it.
        """
        drives = self._with_side(conditions)
        places, units = conditions.places(drives), np.array([drive.unit for drive in drives])
        own = conditions.mean_force[places]
        usual = np.array([own[units == unit].mean() for unit in units])
        force = np.asarray(conditions.drive_force)[:, places] / np.maximum(usual, _NO_FORCE)
        dragged = np.asarray(conditions.approach)[:, places]
        flank = np.where(np.abs(force) > share, -np.sign(force), dragged)
        play = tuple(of_drive(d, "play", 1.0, flank[:, k]) for k, d in enumerate(drives))
        return Form(f"{_PRESSED}{share:g}", play, one_of="friction")  # several together would act like a spring


def _loaded(conditions: Conditions) -> bool:
    """Return whether the forces on drives are known, and their mean in the campaign that shapes refer to."""
    return conditions.forces_known and conditions.mean_force.size > 0
