"""Make a measurement campaign with something hidden in it, and write it to file."""

from __future__ import annotations

import csv
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from .conditions import CENTRE_OF_MASS, PITCH_M, REFERENCE_DEGC, SPAN_M, TARE_KG, Scene, plan
from .effects import CAPS, FORMS, LIBRARY, OUTSIDE, SESSIONS, UNITS, Form, textbook
from .machine import Errors
from .metrology import Tracker, basis, rms, without
from .rotations import Array, from_vector, product, to_vector
from .true_values import true_values

KINDS = ("null", "single", "pair", "outside", "confounded")

CONFOUNDED = (
    ("leg_thermal_expansion", "a", "constant_temperature"),
    ("drive_backlash", "a", "one_side"),
    ("platform_thermal_expansion", None, "constant_temperature"),
    ("tilt_encoder_eccentricity", None, "tilt_held"),
    ("truss_deflection", "a", "slow_travel"),
)
"""Effects, their form if not any, and a way to measure that makes others look the same."""

ALIKE = ({"drive_zero_offset", "joint_centre_offset"}, {"joint_axis_tilt", "joint_centre_offset"})
"""Pairs of which nobody could tell whether it is both or the richer one alone."""

HIDDEN = 16.0
"""Sum of squares, in noise variances, below which nothing shows: an effect that leaves no more explains as well."""

BACKGROUND_CENTRES_M, BACKGROUND_AXES_RAD = 0.015e-3, 0.01e-3

COLUMNS = (
    *("sample", "session", "time_s", "q1_mm", "q2_mm", "q3_mm", "q4_rad"),
    *("approach_q1", "approach_q2", "approach_q3", "approach_q4", "payload_kg", "truss_travel_m"),
    *("melt_degC", "ambient_degC", "leg1_degC", "leg2_degC", "leg3_degC", "leg4_degC", "platform_degC"),
    *("x_mm", "y_mm", "z_mm"),
)
ROTATION_COLUMNS = ("rx_rad", "ry_rad", "rz_rad")


@dataclass(frozen=True)
class Wanted:
    """An effect to hide: its id, its form (drawn if none), and how many times the noise it shall be."""

    effect: str
    ratio: float
    form: str | None = None


@dataclass(frozen=True)
class Campaign:
    """A campaign as it goes to file."""

    rows: list[dict[str, str]]
    settings: dict[str, Any]
    truth: dict[str, Any]


def make_campaign(
    kind: str,
    seed: int | tuple[int, ...],
    *,
    wanted: tuple[Wanted, ...] | None = None,
    trap: str | None = None,
    rows: int | None = None,
    sessions: int | None = None,
    background: bool | None = None,
    full_pose: bool | None = None,
    far_tracker: bool = False,
    spoilt: bool = True,
    turn: int | None = None,
    wide: bool = False,
    workmanship: float = 1.0,
) -> Campaign:
    """Return a campaign of one kind; what is not given is drawn.

    Args:
        kind: null, single, pair, outside or confounded.
        seed: all that is drawn follows from it.
        wanted: effects to hide instead of drawn ones.
        trap: way to measure that makes effects coincide.
        rows: number of poses.
        sessions: number of sessions.
        background: whether small geometric errors are present besides.
        full_pose: whether the orientation is measured too.
        far_tracker: the tracker stands metres away and turned, the target a hand's breadth off.
        spoilt: whether outliers and lost cells may occur.
        turn: which effect of the kind's list to hide; by chance if none.
        wide: whether rows, noise and workmanship vary as they do from shop to shop, not as on this machine alone.
        workmanship: how many times larger than on this machine the small geometric errors are; drawn if ``wide``.
    """
    if kind not in KINDS:
        raise ValueError(f"no kind {kind!r}; there are {', '.join(KINDS)}")
    rng = np.random.default_rng(seed)
    if wanted is None:
        wanted, way = _draw(kind, rng, turn)
        trap = trap or way
    wanted = tuple(_with_form(item, rng) for item in wanted)
    if rows is None:
        rows = int(rng.integers(45, 301)) if wide else int(rng.integers(110, 212))
    drawn = int(rng.choice([1, 1, 1, 2, 3]))
    needed = max([SESSIONS.get((item.effect, str(item.form)), 1) for item in wanted], default=1)
    if background is None:
        background = bool(rng.random() < 0.55) and kind in {"single", "pair", "outside"}
    if full_pose is None:
        full_pose = bool(rng.random() < 0.88)

    explain = kind in {"outside", "confounded"}
    scene = plan(rng, rows, max(sessions or drawn, needed), trap, local=explain)
    sigma = (float(rng.choice([3e-5, 5e-5, 1e-4])), float(rng.choice([3e-5, 6e-5])) if full_pose else None)
    if wide:  # from a good laser tracker to a camera; from a lapped machine to a welded one
        factor = float(np.exp(rng.uniform(np.log(0.015), np.log(0.25)))) * 1e-3 / sigma[0]
        sigma = (sigma[0] * factor, None if sigma[1] is None else sigma[1] * factor)
        workmanship = float(np.exp(rng.uniform(np.log(0.3), np.log(8.0))))
    tracker = Tracker(*frames_of(rng, far_tracker), *sigma)
    faultless = tracker.see(scene, Errors.none(rows))
    frames = basis(tracker.frames(faultless))
    known = _known(scene, tracker, frames) if explain else {}

    total, effects = Errors.none(rows), []
    for item in wanted:
        errors, told, left = _sized(item, scene, tracker, faultless, frames, known, rng)
        total = total + errors
        effects.append(told)
    if background:
        total = total + _background(rng, rows) * workmanship
    accept: list[str] = []
    if kind == "confounded":
        accept = [name for name, value in known.items() if np.sum(without(left, basis(value)) ** 2) < HIDDEN]
        if effects[0]["effect"] not in accept:
            accept.append(effects[0]["effect"])

    position, quaternion = tracker.see(scene, total)
    position = position + rng.normal(0.0, sigma[0], (rows, 3))
    quaternion = product(from_vector(rng.normal(0.0, sigma[1] or 0.0, (rows, 3))), quaternion)
    outliers: list[int] = []
    if spoilt and rng.random() < 0.3:
        outliers = sorted(int(k) for k in rng.choice(rows, int(rng.integers(1, 3)), replace=False))
        kick = rng.uniform(10.0, 120.0, (len(outliers), 3)) * rng.choice([-1.0, 1.0], (len(outliers), 3))
        position[outliers] += kick * sigma[0]
    lost = [int(k) for k in rng.choice(rows, int(rng.integers(1, 4)), replace=False)] if rng.random() < 0.13 else []

    return Campaign(
        rows=cells_of(scene, position, to_vector(quaternion) if full_pose else None, lost if spoilt else [], rng),
        settings=settings_of(*sigma),
        truth={
            "effects": effects,
            "kind": kind,
            "background": workmanship if wide and background else background,
            "outliers": outliers,
            "accept": accept,
            "frames": "unknown base and target frames in every case",
            "seed": list(seed) if isinstance(seed, tuple) else seed,
        },
    )


def write_case(folder: Path | str, campaign: Campaign) -> Path:
    """Write ``campaign.csv``, ``campaign.yaml`` and ``truth.json`` into a folder and return it."""
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / "campaign.csv").open("w", encoding="utf-8", newline="") as file:
        table = csv.DictWriter(file, list(campaign.rows[0]))
        table.writeheader()
        table.writerows(campaign.rows)
    settings = yaml.safe_dump(campaign.settings, sort_keys=False, default_flow_style=False)
    (folder / "campaign.yaml").write_text(settings, encoding="utf-8")
    (folder / "truth.json").write_text(json.dumps(campaign.truth, indent=1) + "\n", encoding="utf-8")
    return folder


def _draw(kind: str, rng: np.random.Generator, turn: int | None) -> tuple[tuple[Wanted, ...], str | None]:
    """Return what to hide and the way to measure; effects come in ``turn`` if one is given, else by chance."""
    if kind == "null":
        return (), None
    if kind == "pair":
        while True:
            both = {str(name) for name in rng.choice(list(LIBRARY), 2, replace=False)}
            if both not in ALIKE:
                return tuple(Wanted(name, float(rng.uniform(3.0, 10.0))) for name in sorted(both)), None
    names = {"single": list(LIBRARY), "outside": list(OUTSIDE), "confounded": [item[0] for item in CONFOUNDED]}[kind]
    turn = (int(rng.integers(len(names))) if turn is None else turn) % len(names)
    low, high = {"single": (1.2, 15.0), "outside": (3.0, 9.0), "confounded": (3.0, 6.0)}[kind]
    ratio = float(np.exp(rng.uniform(np.log(low), np.log(high))))
    if kind != "confounded":
        return (Wanted(names[turn], ratio),), None
    effect, form, trap = CONFOUNDED[turn]
    return (Wanted(effect, ratio, form),), trap


def _with_form(item: Wanted, rng: np.random.Generator) -> Wanted:
    if item.effect not in FORMS:
        raise ValueError(f"no effect {item.effect!r}; there are {', '.join(FORMS)}")
    forms = FORMS[item.effect]
    if item.form is not None and item.form not in forms:
        raise ValueError(f"{item.effect} has no form {item.form!r}; it has {', '.join(forms)}")
    return Wanted(item.effect, item.ratio, item.form or str(rng.choice(list(forms))))


def frames_of(rng: np.random.Generator, far: bool) -> tuple[Array, Array]:
    """Return where the fixed platform stands in the tracker's frame and the target on the platform."""
    if far:
        base = np.concatenate([rng.uniform(-4.0, 4.0, 3), rng.normal(0.0, 0.01, 2), rng.uniform(-3.1, 3.1, 1)])
        target = np.concatenate([rng.uniform(-0.15, 0.15, 3), rng.normal(0.0, 0.01, 3)])
        return base, target
    return rng.normal(0.0, 3e-3, 6), rng.normal(0.0, 3e-3, 6)


def _known(scene: Scene, tracker: Tracker, frames: Array) -> dict[str, Array]:
    """Return the columns of each effect's textbook signature, free frames taken out."""
    columns = {name: tracker.in_own_frame(scene, value) for name, value in textbook(scene).items()}
    return {name: _clean(without(value, frames), value) for name, value in columns.items()}


def _clean(left: Array, whole: Array) -> Array:
    """Return the columns of which the frames left more than rounding."""
    return np.asarray(left[:, np.linalg.norm(left, axis=0) > 1e-7 * np.linalg.norm(whole, axis=0).max()])


def _sized(
    item: Wanted,
    scene: Scene,
    tracker: Tracker,
    faultless: tuple[Array, Array],
    frames: Array,
    known: dict[str, Array],
    rng: np.random.Generator,
) -> tuple[Errors, dict[str, Any], Array]:
    """Return an effect's errors at the wanted ratio, what the truth says of them, and what the frames leave of them."""
    form: Form = FORMS[item.effect][str(item.form)]
    unit = form(scene, rng)
    size, cap, ratio, left, moved = 1e-3, CAPS.get(item.effect, 60.0), 0.0, np.zeros(0), np.zeros(0)
    for _ in range(12):
        moved, turned = tracker.difference(tracker.see(scene, unit * size), faultless)
        left = without(tracker.whiten(moved, turned), frames)
        ratio = rms(left)
        if not ratio:  # such as a knock that is mended before the next session begins: it is drawn anew
            unit = form(scene, rng)
            continue
        if abs(ratio / item.ratio - 1.0) < 1e-9 or (size == cap and ratio < item.ratio):
            break
        size = min(cap, size * item.ratio / ratio)
    told: dict[str, Any] = {
        "effect": item.effect,
        "form": item.form,
        "size": size,
        "ratio_to_noise": ratio,
        "rms_mm": 1e3 * rms(moved),
        "unit": UNITS.get(item.effect, "mm"),
    }
    values = true_values(item.effect, str(item.form), size, scene, unit * size)
    if values:
        told["parameters"] = {name: {"value": value, "unit": unit_of} for name, (value, unit_of) in values.items()}
    if item.effect in OUTSIDE:
        everything = basis(np.concatenate(list(known.values()), axis=1)) if known else frames
        told["ratio_beyond_library"] = rms(without(left, everything))
    return unit * size, told, left


def _background(rng: np.random.Generator, rows: int) -> Errors:
    out = Errors.none(rows)
    out.upper[:] = rng.normal(0.0, BACKGROUND_CENTRES_M, (4, 3))
    out.lower[:] = rng.normal(0.0, BACKGROUND_CENTRES_M, (4, 3))
    out.tilt[:] = rng.normal(0.0, BACKGROUND_AXES_RAD, (4, 5, 3))
    return out


def cells_of(
    scene: Scene, position: Array, rotation: Array | None, lost: list[int], rng: np.random.Generator
) -> list[dict[str, str]]:
    """Return the rows of the file."""
    names = COLUMNS + (ROTATION_COLUMNS if rotation is not None else ())
    gone = {k: str(rng.choice(["x_mm", "y_mm", "z_mm", "leg2_degC"], p=[0.1, 0.1, 0.7, 0.1])) for k in lost}
    out = []
    for k in range(len(scene)):
        values = [
            *(f"{k}", f"{scene.session[k]:.0f}", f"{scene.time_s[k]:.1f}"),
            *(f"{1e3 * value:.5f}" for value in scene.drives[k, :3]),
            f"{scene.drives[k, 3]:.8f}",
            *(f"{value:.0f}" for value in scene.approach[k]),
            *(f"{scene.payload_kg[k]:.1f}", f"{scene.travel_m[k]:.4f}"),
            *(f"{scene.melt[k]:.1f}", f"{scene.ambient[k]:.2f}"),
            *(f"{value:.2f}" for value in scene.thermometers[k]),
            *(f"{1e3 * value:.5f}" for value in position[k]),
            *(f"{value:.9f}" for value in ([] if rotation is None else rotation[k])),
        ]
        row = dict(zip(names, values, strict=True))
        if k in gone:
            row[gone[k]] = ""
        out.append(row)
    return out


def settings_of(sigma_position: float, sigma_rotation: float | None) -> dict[str, Any]:
    """Return the file beside the table."""
    return {
        "robot": "pouring_robot",
        "description": "static poses of the moving platform seen by a laser tracker",
        "metrology": {
            "target": "moving_platform",
            "frame": "tracker",
            "sigma_position_mm": round(1e3 * sigma_position, 6),
            "sigma_rotation_rad": sigma_rotation,
        },
        "drives": {"screw_pitch_mm": 1e3 * PITCH_M},
        "truss": {"span_m": SPAN_M},
        "ladle": {
            "tare_kg": TARE_KG,
            "centre_of_mass_mm": [round(1e3 * value, 6) for value in CENTRE_OF_MASS.tolist()],
        },
        "reference_temperature_degC": REFERENCE_DEGC,
    }
