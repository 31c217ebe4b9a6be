"""The shape of a cause as learned from the data: its curve over what drives it, with a band, against the textbook's."""

from dataclasses import dataclass

import numpy as np

from pouring_robot.diagnosis.conclusions import Conclusions
from pouring_robot.diagnosis.named_effects import NamedEffect
from pouring_robot.effects.base import channel
from pouring_robot.effects.condition_facts import Axis, of_drives
from pouring_robot.estimation.changes import SCALE
from pouring_robot.estimation.intervals import deviations95, largest_std
from pouring_robot.io.units import shown_in
from pouring_robot.mechanism.arrays import FloatArray, rms
from pouring_robot.mechanism.local_parameters import component_unit


@dataclass(frozen=True, eq=False)
class Shape:
    """An effect's change of one local parameter in each row."""

    channel: str  # name of the local parameter
    unit: str  # of the values
    axis: Axis  # what drives the effect
    learned: FloatArray  # with all shaping parameters, (n,)
    std: FloatArray  # standard deviation of that, (n,)
    textbook: FloatArray  # by its main parameters alone, (n,)


def shape_of(diagnosis: Conclusions, effect: NamedEffect) -> Shape | None:
    """Return the shape of what an effect moves most; None where it is the textbook's up to chance (95 %)."""
    parameters = [found.parameter for found in effect.parameters]
    if all(p.main for p in parameters) or not effect.cause.indices:
        return None
    values = np.array([found.value for found in effect.parameters])
    # Change of a local parameter by one unit of each parameter, (n, p).
    moves = {
        name: np.column_stack(np.broadcast_arrays(*(p.changes.get(name, 0.0) for p in parameters)))
        for name in dict.fromkeys(name for p in parameters for name in p.changes)
    }
    most = max(moves, key=lambda name: float(np.square(moves[name] @ values).sum()))
    main = np.array([p.main for p in parameters])
    units = diagnosis.units_of(effect)
    learned, textbook = moves[most] @ values, moves[most] @ (main * values)
    apart = largest_std(moves[most] @ (~main[:, None] * units), diagnosis.covariances)
    if rms(learned - textbook) <= deviations95(diagnosis.noise.dof) * rms(apart):
        return None
    std = largest_std(moves[most] @ units, diagnosis.covariances)
    unit, factor = _unit(diagnosis, most)
    axis = _driving_axis(diagnosis, effect, most)
    return Shape(most, unit, axis, learned / factor, std / factor, textbook / factor)


def _driving_axis(diagnosis: Conclusions, effect: NamedEffect, name: str) -> Axis:
    """Return what drives an effect: the drive's own value if drives' values do."""
    given = diagnosis.rows.conditions
    known = diagnosis.diagnoser.library.effects[effect.cause.effect]
    drives = [channel(drive) for drive in given.robot.drives]
    if name in drives and known.driver in of_drives(given.robot):
        drive = given.robot.drives[drives.index(name)]
        return Axis(f"{drive.words} [{drive.unit}]", given.drives[:, drives.index(name)])
    return known.axis(given)


def _unit(diagnosis: Conclusions, name: str) -> tuple[str, float]:
    """Return the unit in which a local parameter is shown, and its size in SI units."""
    if name == SCALE:
        return "1e-6", 1e-6
    units = {channel(drive): drive.unit for drive in diagnosis.rows.conditions.robot.drives}
    return shown_in(units.get(name) or component_unit(name.rpartition(".")[2]))
