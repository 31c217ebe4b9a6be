"""What an effect is: a change of the mechanism's local parameters, row by row, that depends on conditions.

An effect is linear in its parameters: each defines, row by row, how one unit of it changes local parameters. To first
order, the transfer matrix propagates these changes to the end body; exactly, the loops are closed with the changes
applied. Nonlinear constants (a time constant, a power) distinguish the *forms* of an effect.

    class ScrewWear(Effect):
        id = "screw_wear"
        story = "the screw is worn in the middle of its stroke"
        driven_by = "lengths_m"  # of the sliding drives

        def forms(self, conditions):
            stroke = conditions.lengths_m[:, 0] - 0.6
            change = {"drive.lift": 1e-3 * np.exp(-((stroke / 0.1) ** 2))}  # of the joint "lift"
            return (Form("bell", (EffectParameter("wear_1", "mm", prior_std=0.5, changes=change),)),)

See :mod:`pouring_robot.effects.available` for how a package offers its effects.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from pouring_robot.effects.condition_facts import ALWAYS, Axis, axis_over, facts_of
from pouring_robot.effects.conditions import Conditions
from pouring_robot.exceptions import BadInputError, closest
from pouring_robot.io.units import shown_in
from pouring_robot.mechanism.arrays import BoolArray, FloatArray
from pouring_robot.robot.description.definition import RobotDefinition
from pouring_robot.robot.description.drive import Drive

LocalChanges = Mapping[str, FloatArray]
"""Change of local parameters, (n,) each, in m and rad, by the parameter's name: ``drive.<joint>``, ``base.tz`` (of the
base in its own axes), ``<joint>.tx``, ``<joint>.rz`` …, and ``metrology.scale`` (relative)."""


@dataclass(frozen=True, eq=False)
class EffectParameter:
    """One parameter of a form."""

    name: str  # short, unique in its form
    unit: str  # the user's unit of its value
    # prior standard deviation where the effect is present, in ``unit``. Only the ratios between the parameters of a
    # form matter much: their common scale is estimated from the data.
    prior_std: float
    changes: LocalChanges = field(repr=False)  # change of local parameters for one ``unit``
    main: bool = True  # whether it makes the effect; if not, it only shapes what the main parameters make
    bounds: tuple[float, float] = (-float("inf"), float("inf"))  # what is physically possible, in ``unit``

    def __post_init__(self) -> None:
        # A list, or an array of booleans, will do as well.
        floats = {name: np.asarray(change, dtype=float) for name, change in self.changes.items()}
        object.__setattr__(self, "changes", floats)


@dataclass(frozen=True, eq=False)
class Form:
    """One way in which an effect can act."""

    name: str  # unique in its effect
    parameters: tuple[EffectParameter, ...]  # the parameters, main ones first
    # name of a constant of which this form is one value: of the forms that share it at most one can be present. "" for
    # forms that can be present together with any other.
    one_of: str = ""
    series: bool = False  # whether its parameters are terms of a series, enough of which represent any function
    # matrix that multiplies values before they are reported, (k, k), from a mask of the fitted rows, (n,). A
    # combination of values that has no effect is as uncertain as its prior, which would widen the interval of each.
    reporting_matrix: Callable[[BoolArray], FloatArray] | None = field(default=None, repr=False)


class Effect(ABC):
    """A physical cause that moves the end body. Stateless; one instance serves all campaigns of a robot."""

    id: str  # name in files and on the command line
    story: str  # one line for people: what happens on the machine
    # names, in their robot files, of the robots it is for: those that have what it changes and what drives it; () for
    # all
    robots: tuple[str, ...] = ()
    # conditions without which it cannot be tested, by the names that :meth:`Conditions.value` takes
    needs: tuple[str, ...] = ()
    substitute: str = ""  # what can replace what is :meth:`missing`, in words
    # conditions that also shape it where a campaign has them; an effect learned with them needs them elsewhere
    shaped_by: tuple[str, ...] = ()
    moves_robot: bool = True  # whether it moves the robot, not only what is measured of it
    periodic: bool = False  # whether it is stated to repeat with every turn of the joints that it moves
    # condition over which it is plotted and which must vary for it to be observable, one of
    # :func:`~pouring_robot.effects.condition_facts.known_facts`; by default the first of :attr:`needs`
    driven_by: str = ""
    # measurement that distinguishes it from other effects, in words; by default what varies :attr:`driven_by`
    distinguished_by: str = ""

    @property
    def driver(self) -> str:
        """Name of the condition that drives it; "" where none does."""
        return self.driven_by or next(iter(self.needs), "")

    @property
    def campaign_specific(self) -> bool:
        """Whether it depends on a campaign's own time or sessions, so that it differs in another campaign."""
        return self.driver in ("time_s", "session")

    def distinguishing_measurement(self, conditions: Conditions) -> str:
        """Return which measurement distinguishes it from other effects, in words; "" where none is stated."""
        return self.distinguished_by or facts_of(self.driver, conditions.robot).vary

    def axis(self, conditions: Conditions) -> Axis:
        """Return the axis over which it is best plotted in a campaign."""
        return axis_over((self.driver, *self.needs, *ALWAYS), conditions)

    def workmanship(self, conditions: Conditions) -> tuple[EffectParameter, ...]:
        """Return the errors of its kind that manufacture leaves in every machine, but far smaller; by default none.

        Their ``prior_std`` are those of the effect. How much smaller they are is estimated from the campaign.
        """
        return ()

    def in_words(self, values: Mapping[str, float], stds: Mapping[str, float]) -> tuple[str, ...]:
        """Return what its parameters say together but none says alone, a sentence each; by default nothing.

        It is printed instead of the parameters. ``values`` are those of the parameters found, by name, each in its
        unit; ``stds`` are their standard deviations.
        """
        return ()

    def to_read_with_care(self, conditions: Conditions) -> tuple[str, ...]:
        """Return what in a campaign makes its parameters less certain than they look, a sentence each.

        By default nothing.
        """
        return ()

    def rows_not_learned(self, conditions: Conditions, form: str) -> Mapping[str, int]:
        """Return in how many rows a form is taken as zero because the campaign it was learned in did not reach there.

        The keys are parts, in words. By default what was learned holds everywhere.
        """
        return {}

    def can_occur(self, conditions: Conditions) -> bool:
        """Return whether it could ever move this robot, whatever else is varied; by default it could."""
        return True

    def missing(self, conditions: Conditions) -> tuple[str, ...]:
        """Return the needed conditions that a campaign does not have."""
        return tuple(name for name in self.needs if conditions.value(name) is None)

    @abstractmethod
    def forms(self, conditions: Conditions) -> Sequence[Form]:
        """Return the forms of the effect under conditions that have all that it :attr:`needs`, the usual one first."""

    def form(self, name: str, conditions: Conditions) -> Form:
        """Return one form by its name; raises BadInputError if the effect has no such form."""
        found = {form.name: form for form in self.forms(conditions)}
        if name not in found:
            raise BadInputError(f"the effect '{self.id}' has no form '{name}'{closest(name, found)}")
        return found[name]


def not_for(robot: RobotDefinition) -> str:
    """Return how to correct an effect that a robot cannot have, in words."""
    return f"correct its class or, if it is not for the robot '{robot.name}', list the robots it is for in its `robots`"


def checked_forms(effect: Effect, conditions: Conditions, channels: Collection[str]) -> tuple[Form, ...]:
    """Return the forms of an effect, which may be a user's, after a check of what they change.

    The n conditions lack nothing that it needs; ``channels`` are the names of the existing local parameters. Raises
    BadInputError if the effect fails, changes what does not exist, or its changes are not n finite numbers.
    """
    try:
        forms = tuple(effect.forms(conditions))
    except Exception as problem:  # a user's effect may fail in any way; the line must say which one
        why = " ".join(f"{type(problem).__name__}: {problem}".split())
        said = f"the effect '{effect.id}' fails under the conditions of this campaign: {why}"
        raise BadInputError(f"{said}; {not_for(conditions.robot)}") from problem
    names = [form.name for form in forms]
    if not forms or len(set(names)) < len(names) or not all(any(p.main for p in form.parameters) for form in forms):
        raise BadInputError(f"the effect '{effect.id}' needs forms with different names, each with a main parameter")
    for form in forms:
        called = [parameter.name for parameter in form.parameters]
        if len(set(called)) < len(called):  # a model file holds their values by name
            raise BadInputError(f"the effect '{effect.id}', form '{form.name}' needs parameters with different names")
        for parameter in form.parameters:
            where = f"the effect '{effect.id}', form '{form.name}', parameter '{parameter.name}'"
            for name, change in parameter.changes.items():
                if name not in channels:
                    near, mend = closest(name, channels), not_for(conditions.robot)
                    raise BadInputError(f"{where} changes '{name}', which the robot does not have{near}; {mend}")
                if np.shape(change) != (len(conditions),) or not np.isfinite(change).all():
                    raise BadInputError(f"{where} must change '{name}' by one finite number for each row")
            if not 0.0 < parameter.prior_std < np.inf:
                raise BadInputError(f"{where} needs a usual size above zero, not {parameter.prior_std:g}")
            if not parameter.bounds[0] < parameter.bounds[1]:
                raise BadInputError(f"{where} needs bounds with the lower one first, not {parameter.bounds}")
    return forms


@dataclass(eq=False)
class Family(Effect):
    """A family of effects, applied to parts of one robot.

    Usual sizes are orders of magnitude: evidence is averaged from a hundredth to ten times them, and what only shapes
    an effect from 0.03 to 1 of what it shapes (docs/inference.md, "Two scales an effect").
    """

    id: str  # name in files and on the command line
    story: str  # one line for people
    drives: tuple[Drive, ...] = ()  # on which it acts


def channel(drive: Drive) -> str:
    """Return the name of the local parameter that moves a drive."""
    return f"drive.{drive.joint}"


def of_drives(drives: Sequence[Drive], unit: float, courses: FloatArray) -> dict[str, FloatArray]:
    """Return the changes of all drives: ``courses``, their values row by row, (n, drives), times a unit in m or rad."""
    return {channel(drive): unit * courses[:, k] for k, drive in enumerate(drives)}


def of_drive(
    drive: Drive, name: str, prior_std: float, course: FloatArray, main: bool = True, per: str = ""
) -> EffectParameter:
    """Return a parameter that moves one drive by ``course``, (n,), in the drive's unit, to which ``per`` is added."""
    unit, si = shown_in(drive.unit)
    return EffectParameter(f"{drive.symbol}_{name}", unit + per, prior_std, {channel(drive): si * course}, main)


def of_each(
    conditions: Conditions,
    drives: Sequence[Drive],
    name: str,
    prior_std: float,
    courses: FloatArray,
    main: bool = True,
    per: str = "",
) -> list[EffectParameter]:
    """Return such a parameter for each of some drives, by its column of the courses of all drives, (n, D)."""
    columns = zip(drives, conditions.places(drives), strict=True)
    return [of_drive(drive, name, prior_std, courses[:, k], main, per) for drive, k in columns]
