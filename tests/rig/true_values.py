"""True values of an effect's constants, where its form is the textbook's: for checking intervals of estimates.

Only form ``a`` has comparable constants: drives, expansion, springs, the truss, creep, the scale. Joint centres and
axes are left out: only combinations of them are identifiable.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from .conditions import PITCH_M, Scene
from .effects_drives import MM, MRAD
from .machine import Errors
from .rotations import Array

DRIVES = ("l1", "l2", "l3", "theta46")
PPM = 1e-6

Values = dict[str, tuple[float, str]]


def true_values(effect: str, form: str, size: float, scene: Scene, errors: Errors) -> Values:
    """Return value and unit of each constant by its name; nothing where the form is not the textbook's.

    Args:
        effect: its id.
        form: its form.
        size: its size, in the units of :data:`tests.rig.effects.UNITS`.
        scene: the campaign.
        errors: what the effect does, at that size.
    """
    return _VALUES[effect](size, scene, errors) if form == "a" and effect in _VALUES else {}


def _per(courses: Array, values: Array) -> Array:
    """Return the factors (k,) that make values (n, k) of courses (n, k)."""
    return np.asarray((courses * values).sum(axis=0) / (courses**2).sum(axis=0))


def _offsets(_: float, scene: Scene, errors: Errors) -> Values:
    values = [*(errors.length[0, :3] / MM).tolist(), float(errors.theta[0] / MRAD)]
    return {f"{name}_offset": (value, _unit(name)) for name, value in zip(DRIVES, values, strict=True)}


def _unit(drive: str) -> str:
    return "mrad" if drive == "theta46" else "mm"


def _scales(_: float, scene: Scene, errors: Errors) -> Values:
    values = _per(scene.legs[:, :3], errors.length[:, :3] / MM).tolist()
    return {f"{name}_scale": (value, "mm/m") for name, value in zip(DRIVES, values, strict=False)}


def _plays(_: float, scene: Scene, errors: Errors) -> Values:
    values = np.column_stack([errors.length[:, :3] / MM, errors.theta / MRAD])
    found = _per(scene.approach, values).tolist()
    return {f"{name}_play": (value, _unit(name)) for name, value in zip(DRIVES, found, strict=True)}


def _waves(angle: Array, values: Array, drive: str) -> Values:
    """Return sine and cosine of values (n,) that go with an angle (n,)."""
    found = np.linalg.lstsq(np.column_stack([np.sin(angle), np.cos(angle)]), values, rcond=None)[0].tolist()
    return {f"{drive}_{name}_1": (v, _unit(drive)) for name, v in zip(("sine", "cosine"), found, strict=True)}


def _turns(_: float, scene: Scene, errors: Errors) -> Values:
    angle = 2.0 * np.pi * scene.drives[:, :3] / PITCH_M
    found: Values = {}
    for k in range(3):
        found |= _waves(angle[:, k], errors.length[:, k] / MM, DRIVES[k])
    return found


def _eccentricity(_: float, scene: Scene, errors: Errors) -> Values:
    return _waves(scene.drives[:, 3], errors.theta / MRAD, DRIVES[3])


def _expansion(size: float, _: Scene, __: Errors) -> Values:
    return {"expansion": (10.0 * size, "1e-6/K")}


def _stretch(size: float, _: Scene, __: Errors) -> Values:
    return {"stretch": (size, "mm at 5 kN")}


def _yield(size: float, _: Scene, __: Errors) -> Values:
    return {"yield": (size, "mrad at 2 kNm")}


def _sink(size: float, _: Scene, __: Errors) -> Values:
    return {"sink": (size, "mm at 6.5 kN")}


def _creep(_: float, __: Scene, errors: Errors) -> Values:
    way = errors.base[-1] - errors.base[0]
    return {
        name: (float(way[k] / (MM if k < 3 else MRAD)), "mm" if k < 3 else "mrad")
        for k, name in enumerate(("tx", "ty", "tz", "rx", "ry", "rz"))
    }


def _scale(_: float, __: Scene, errors: Errors) -> Values:
    return {"scale": (float(errors.scale[0] / PPM), "1e-6")}


_VALUES: dict[str, Callable[[float, Scene, Errors], Values]] = {
    "drive_zero_offset": _offsets,
    "drive_scale": _scales,
    "drive_cyclic": _turns,
    "drive_backlash": _plays,
    "leg_thermal_expansion": _expansion,
    "platform_thermal_expansion": _expansion,
    "leg_compliance": _stretch,
    "tilt_drive_compliance": _yield,
    "truss_deflection": _sink,
    "base_drift": _creep,
    "tilt_encoder_eccentricity": _eccentricity,
    "metrology_scale": _scale,
}
