"""What a campaign over part of a turn leaves uncertain about an error that is periodic in a joint's turn."""

from collections import Counter

import numpy as np

from pouring_robot.diagnosis.conclusions import Conclusions
from pouring_robot.diagnosis.named_effects import NamedEffect
from pouring_robot.effects.base import channel
from pouring_robot.effects.stack_in_rows import local_changes
from pouring_robot.inference.problem import Nuisance
from pouring_robot.mechanism.arrays import FloatArray

_TELLS_ORDERS_DEG = 270.0
"""Over a smaller arc, waves of neighbouring orders correlate by three tenths or more: sin x over x of half the arc."""
_SMOOTH = 3
"""Degree of a smooth curve: a zero, a ratio, and for either phase of a wave its first term beyond these."""


def left_open(diagnosis: Conclusions, effect: NamedEffect) -> tuple[str, ...]:
    """Return what makes waves in joints' turns less certain than they look, a sentence each.

    Joints turned so little that one order does what another does, or that a smooth curve of the angle does what was
    found: with such a curve the wave is hidden (:attr:`~pouring_robot.inference.thresholds.Thresholds.hidden`).
    """
    given, hidden = diagnosis.rows.conditions, diagnosis.diagnoser.asked.hidden
    if not diagnosis.diagnoser.library.effects[effect.cause.effect].periodic:
        return ()
    terms = Counter(name for found in effect.parameters if found.parameter.main for name in found.parameter.changes)
    curves = local_changes([p.parameter for p in effect.parameters], [p.value for p in effect.parameters])
    linear, orders, smooth = diagnosis.diagnoser.at_rest().linear, list[str](), list[str]()
    frames = Nuisance.of(linear.free)
    for drive, angles in zip(given.robot.drives, given.drives.T, strict=True):
        if (name := channel(drive)) in curves:
            turned = turned_deg(angles)
            steps = (angles - angles.mean()) / (np.ptp(angles) or 1.0)
            courses = [curves[name], *(steps**k for k in range(_SMOOTH + 1))]
            parts = [frames.cleared(diagnosis.rows.signature({name: course}, linear)) for course in courses]
            whole, left = _squares(*parts)
            orders += [f"{drive.words} {turned:.0f}°"] if turned < _TELLS_ORDERS_DEG and terms[name] > 2 else []
            smooth += [f"{drive.words} {turned:.0f}°"] if left <= hidden < whole else []
    sentences = {
        "turned too little to distinguish the orders": orders,
        "in these poses a smooth error that does not repeat with turns, as of a bending part, looks the same": smooth,
    }
    return tuple(f"{said}: {', '.join(joints)}" for said, joints in sentences.items() if joints)


def turned_deg(angles: FloatArray) -> float:
    """Return the part of a turn that angles (n,), in rad, span, in degrees: all but the widest gap."""
    places = np.unique(angles % (2.0 * np.pi))
    return 360.0 - float(np.degrees(np.diff(places, append=places[0] + 2.0 * np.pi).max()))


def _squares(part: FloatArray, *terms: FloatArray) -> tuple[float, float]:
    """Return the sum of squares of a part (m,), and of its residual after a fit of some terms (m,)."""
    smooth = np.column_stack(terms)
    left = part - smooth @ np.linalg.lstsq(smooth, part, rcond=None)[0]
    return float(part @ part), float(left @ left)
