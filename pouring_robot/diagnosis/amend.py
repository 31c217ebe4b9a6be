"""The amended model: what was found is added where it acts.

Constant errors, such as a displaced joint, become part of the robot's placements and drive offsets, which every command
uses. What depends on conditions stays in the effect stack with its parameters, to be applied row by row.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pouring_robot.diagnosis.findings import Findings
from pouring_robot.diagnosis.named_effects import FoundByKey, FoundParameter
from pouring_robot.effects.base import EffectParameter
from pouring_robot.effects.conditions import learned_in
from pouring_robot.estimation.frames.outer import FRAMES
from pouring_robot.estimation.measurement import MeasurementModel
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.robot.effect_stack import EffectEntry, ParameterEntry
from pouring_robot.robot.model import RobotModel

_VALUE_DIGITS, _STD_DIGITS = 9, 4
_STILL = 1e-12


def amended(diagnosis: Findings) -> RobotModel:
    """Return the given model with everything added that the diagnosis fitted, marked if it is worse on held-out rows.

    Placements are composed exactly. The diagnosis adds up the twists at one joint, which differs in the second order of
    its rotations.

    Raises:
        CalibrationError: a displacement is too large to be an error of a robot.
    """
    entries, placed, inside = list[EffectEntry](), list[FoundParameter](), diagnosis.rows.measurement
    known = diagnosis.diagnoser.library.effects
    for (effect, form), parameters in _found(diagnosis):
        still = [p for p in parameters if not known[effect].needs and stands_still(p.parameter, inside.names[FRAMES:])]
        placed += still
        for fixed, chosen in ((True, still), (False, [p for p in parameters if p not in still])):
            if chosen:
                entries.append(_entry(effect, form, fixed, chosen))
    model = inside.amended(_local(inside, placed))
    learned, name = dict(diagnosis.model.learned), diagnosis.campaign.path.stem
    while name in learned:
        name += "_again"
    if diagnosis.overfitted or not all(entry.placed for entry in entries):
        here = learned_in(diagnosis.rows.campaign, diagnosis.rows.conditions)
        learned[name] = here.model_copy(update={"worse": diagnosis.overfitted})
    entries = [entry if entry.placed else entry.model_copy(update={"learned": name}) for entry in entries]
    return model.model_copy(update={"effects": [*diagnosis.model.effects, *entries], "learned": learned})


def stands_still(parameter: EffectParameter, inside: Sequence[str]) -> bool:
    """Return whether a parameter, of an effect without conditions, changes only joints and drives, equally in all rows.

    These are inside the mechanism (``inside``); the fixed platform and the tracker are not.
    """
    known = set(inside)
    return all(
        name in known and float(np.ptp(change)) <= _STILL * float(np.abs(change).max(initial=0.0))
        for name, change in parameter.changes.items()
    )


def _found(diagnosis: Findings) -> FoundByKey:
    """Return parameters by effect and form, as the amended robot has them.

    Values are those with which its loops were closed. A parameter that was dropped at the last settling, as too small
    to matter, is still in it; its standard deviation is that of its prior.
    """
    left, found = diagnosis.final.state.by_parameter, FoundByKey()
    for key, parameters in diagnosis.parameters:
        own = (replace(p, value=left[p.parameter].pop(0)) for p in parameters if left.get(p.parameter))
        found.append((key, tuple(own)))
    # The remaining ones belong to the largest form of which all parameters are there.
    forms = diagnosis.diagnoser.library.every_form.items()
    for key, whole in sorted(forms, key=lambda item: -len(item[1].parameters)):
        if all(left.get(p) for p in whole.parameters):
            found.append((key, tuple(FoundParameter(p, left[p].pop(0), p.prior_std) for p in whole.parameters)))
    return found


def _entry(effect: str, form: str, placed: bool, parameters: Sequence[FoundParameter]) -> EffectEntry:
    entries = {}
    for p in parameters:
        value, std = round(p.value, _VALUE_DIGITS), float(f"{p.std:.{_STD_DIGITS}g}")
        entries[p.parameter.name] = ParameterEntry(value=value, std=std, unit=p.parameter.unit)
    return EffectEntry(effect=effect, form=form, placed=placed, parameters=entries)


def _local(inside: MeasurementModel, placed: Sequence[FoundParameter]) -> FloatArray:
    """Return the local parameters (P,) that placed parameters make together, in m and rad."""
    total, names = np.zeros(len(inside.parameters)), inside.names[FRAMES:]
    for one in placed:
        for name, change in one.parameter.changes.items():
            total[names.index(name)] += one.value * float(change[0])
    return total
