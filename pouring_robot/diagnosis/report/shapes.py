"""The shape of an effect as the campaign shows it, beside the textbook's: what it moves most, over what drives it."""

from dataclasses import dataclass
from itertools import accumulate, pairwise

import numpy as np

from pouring_robot.diagnosis.findings import Findings
from pouring_robot.diagnosis.parameters import NamedEffect
from pouring_robot.diagnosis.rows import SCALE
from pouring_robot.effects.base import EffectParameter, channel
from pouring_robot.effects.facts import Axis, of_drives
from pouring_robot.inference.processes import variances_of
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.poses import MM, MRAD


@dataclass(frozen=True, eq=False)
class Shape:
    """What an effect does to one local parameter in each row.

    Attributes:
        channel: name of the local parameter.
        unit: that the figures count in.
        axis: what drives the effect.
        learned: with all that shapes it, (n,).
        std: standard deviation of that, (n,).
        textbook: by its main parameters alone, (n,).
    """

    channel: str
    unit: str
    axis: Axis
    learned: FloatArray
    std: FloatArray
    textbook: FloatArray


def shape_of(diagnosis: Findings, effect: NamedEffect) -> Shape | None:
    """Return what an effect moves most; None where no more than chance shapes it: it is the textbook's."""
    parameters = [found.parameter for found in effect.parameters]
    if all(p.main for p in parameters) or not effect.cause.indices:
        return None
    values = np.array([found.value for found in effect.parameters])
    moves = {name: _moves(name, parameters) for p in parameters for name in p.changes}
    most = max(moves, key=lambda name: float(np.square(moves[name] @ values).sum()))
    main = np.array([p.main for p in parameters])
    std = np.sqrt(variances_of(moves[most], _covariance(diagnosis, effect, parameters)))
    learned, textbook = moves[most] @ values, moves[most] @ (main * values)
    if np.square(learned - textbook).mean() <= np.square(std).mean():
        return None
    factor, unit = _unit(diagnosis, most)
    axis = _axis(diagnosis, effect, most)
    return Shape(most, unit, axis, learned / factor, std / factor, textbook / factor)


def _covariance(diagnosis: Findings, effect: NamedEffect, parameters: list[EffectParameter]) -> FloatArray:
    """Return that of an effect's parameters, in their units, (p, p)."""
    hypothesis = diagnosis.hypothesis
    weights = hypothesis.weights()
    places = list(pairwise(accumulate((len(own) for own in weights), initial=0)))
    first = len(weights) - len(hypothesis.items)  # workmanship stands before items
    own = np.concatenate([np.arange(*places[first + k]) for k in effect.cause.indices])
    units = np.concatenate(weights)[own] * np.array([p.prior_std for p in parameters])
    covariance = hypothesis.coefficients()[1]
    return np.asarray(units[:, None] * covariance[own[:, None], own] * units)


def _moves(name: str, parameters: list[EffectParameter]) -> FloatArray:
    """Return what one unit of each parameter does to a local parameter, (n, p)."""
    changes = [p.changes.get(name) for p in parameters]
    count = next(len(change) for change in changes if change is not None)
    return np.column_stack([np.zeros(count) if change is None else change for change in changes])


def _axis(diagnosis: Findings, effect: NamedEffect, name: str) -> Axis:
    """Return what drives an effect: the drive's own value where drives' values do."""
    given = diagnosis.rows.conditions
    known = diagnosis.diagnoser.library.effects[effect.cause.effect]
    drives = [channel(drive) for drive in given.robot.drives]
    if name in drives and known.driver in of_drives(given.robot):
        drive = given.robot.drives[drives.index(name)]
        return Axis(f"{drive.words} [{drive.unit}]", given.drives[:, drives.index(name)])
    return known.axis(given)


def _unit(diagnosis: Findings, name: str) -> tuple[float, str]:
    """Return the unit that a local parameter is shown in: its size in SI units and its name."""
    if name == SCALE:
        return 1e-6, "1e-6"
    of_drives = {channel(drive): drive.unit == "rad" for drive in diagnosis.rows.conditions.robot.drives}
    turning = of_drives.get(name, name.rpartition(".")[2].startswith("r"))
    return (MRAD, "mrad") if turning else (MM, "mm")
