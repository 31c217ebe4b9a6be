"""A case: scene, machine, faults of a wanted size, noise; written as campaign.csv, campaign.yaml and truth.json."""

import csv
import json
from dataclasses import dataclass

import numpy as np
import yaml
from scipy.spatial.transform import Rotation

from tests.examiner import coincidences, conditions, faults, strangers
from tests.examiner.judge import DETECTABLE, Judge
from tests.examiner.machine import NoEquilibriumError, turn
from tests.examiner.rig import Fault, Rig

KINDS = ["null"] * 5 + ["single"] * 7 + ["pair"] * 3 + ["outside"] * 3 + ["confounded"] * 2
KNOWN, STRANGE = list(faults.FORMS), list(strangers.FORMS)
FORMS = faults.FORMS | strangers.FORMS
STANDS_OUT = 4.0  # deviations of workmanship that a fault of workmanship must reach to be one
ATTEMPTS = 60


class NoCaseError(RuntimeError):
    """No believable campaign of the wanted kind was drawn."""


@dataclass
class Case:
    """One campaign: the rig with its faults, and what is true of it."""

    rig: Rig
    truth: dict


class Unlikely(Exception):  # noqa: N818
    """A drawn case that no workshop would believe, or that shows nothing: drawn anew."""


def workmanship_floor(fault, scale):
    """Return the size below which a fault of this effect is ordinary workmanship."""
    base = {"joint_centre_offset": 0.015, "joint_axis_tilt": 0.01}
    return STANDS_OUT * base.get(fault.effect, 0.0) * scale


def dose(rig, judge, fault, most, ratio):
    """Set the fault's size so that it shows with that ratio to the noise; return ratio and rms_mm reached.

    Raises:
        Unlikely: if that takes more than a believable size, or cannot be met.
    """
    before = rig.see([f for f in rig.faults if f is not fault])
    for _ in range(6):
        after = rig.see()
        reached = judge.ratio(before, after)
        if abs(reached - ratio) < 0.02 * ratio:
            if fault.size > most:
                raise Unlikely(f"{fault.form}: size {fault.size:.3g}")
            return reached, judge.rms_mm(before, after)
        if reached < 1e-6 * ratio or fault.size > 30 * most:
            raise Unlikely(f"{fault.form}: shows {reached:.3g} at size {fault.size:.3g}")
        fault.size *= ratio / reached
    raise Unlikely(f"{fault.form}: no size shows {ratio:.3g}")


def choose(rng, kind, index):
    """Return the effects of a case; over many cases every effect has its turn."""
    if kind in {"single", "pair"}:
        first = KNOWN[index % len(KNOWN)]
        return [first] if kind == "single" else [first, str(rng.choice([e for e in KNOWN if e != first]))]
    return [STRANGE[index % len(STRANGE)]] if kind == "outside" else []


def attempt(rng, kind, index, seed):
    """Return a case, or raise Unlikely."""
    names = choose(np.random.default_rng([seed, index]), kind, index)
    scene = conditions.draw(rng, fine="metrology_scale" in names)
    if kind == "confounded":
        names = [coincidences.arrange(rng, scene, index)]
    scale = float(np.exp(rng.uniform(np.log(0.3), np.log(8))))
    rig = Rig(rng, scene, scale)
    judge = Judge(rig)
    sag = rig.stiffen(judge)
    ratios = []
    most = {}
    for name in names:
        fault, most[name] = faults.draw(rng, scene, name, FORMS[name])
        fault.size = 0.1 if np.isfinite(most[name]) else 1.0
        rig.faults.append(fault)
        ratios.append(float(np.exp(rng.uniform(np.log(3 if kind in {"pair", "outside"} else 1), np.log(15)))))
    found = []
    for _ in range(2 if len(names) > 1 else 1):
        found = [dose(rig, judge, f, most[f.effect], r) for f, r in zip(rig.faults, ratios, strict=True)]
    for fault in rig.faults:
        if fault.size < workmanship_floor(fault, scale):
            raise Unlikely(f"{fault.form}: ordinary workmanship")
    alike = explain(rig, judge) if names else {}
    accept = sorted({name for name, rest in alike.items() if rest < DETECTABLE} | set(names))
    if kind == "pair" and min(alike.values()) < DETECTABLE:
        raise Unlikely(f"{names}: one effect explains both")
    if kind == "confounded" and len(accept) < 2:
        raise Unlikely(f"{names[0]}: alone, {alike}")
    if kind == "outside" and min(alike.values()) < max(4 * DETECTABLE, 0.2 * alike["none"]):
        raise Unlikely(f"{names[0]}: explained, {alike}")
    sound = drawn_sound(rig)
    truth = {
        "kind": kind,
        "effects": [describe(f, *reached) for f, reached in zip(rig.faults, found, strict=True)],
        # A sound machine has errors of workmanship: to name them is no false alarm.
        "accept": {"confounded": accept, "null": ["joint_axis_tilt", "joint_centre_offset"]}.get(kind, []),
        "alternatives": [name for name in accept if name not in names],
        "background": True,
        "seed": seed,
        "workmanship": {"scale": scale, "centres_sd_mm": 0.015 * scale, "axes_sd_mrad": 0.01 * scale,
                        "ratio_to_noise": judge.ratio(sound, rig.see(faults=[], weight=False))},
        "noise": {"sigma_position_mm": 1e3 * scene.sigma, "sigma_rotation_rad": scene.sigma_turn,
                  "stated": scene.stated},
        "weight_ratio_to_noise": sag,
        "frames": "unknown base and target frames in every case",
    }  # fmt: skip
    return Case(rig, truth)


def drawn_sound(rig):
    """Return what the same machine without workmanship errors shows, cold and unloaded."""
    centres, axes = rig.centres, rig.axes
    rig.centres, rig.axes = [0 * v for v in centres], [0 * v for v in axes]
    sight = rig.see(faults=[], weight=False)
    rig.centres, rig.axes = centres, axes
    return sight


def explain(rig, judge):
    """Return {effect: rest} for what all faults together do; `none` is the whole."""
    gap = judge.gap(rig.see(faults=[]), rig.see())
    return {"none": float(gap @ gap), **judge.alike(gap)}


def describe(fault: Fault, ratio, rms_mm):
    """Return a fault's entry of truth.json."""
    return {"effect": fault.effect, "form": fault.form, "size": fault.size, "ratio_to_noise": ratio, "rms_mm": rms_mm}


def make(seed, number, kind, index):
    """Return the case of that number: drawn until it is believable.

    Raises:
        NoCaseError: if none of many was.
    """
    for trial in range(ATTEMPTS):
        try:
            return attempt(np.random.default_rng([seed, number, trial]), kind, index, seed)
        except (Unlikely, NoEquilibriumError):
            continue
    raise NoCaseError(f"case {number} ({kind} {index}) of seed {seed}: nothing believable in {ATTEMPTS} draws")


def plan(count, seed):
    """Return [(kind, running number within the kind)] of a series: the proportions hold in every twenty."""
    rng = np.random.default_rng(seed)
    kinds = [k for _ in range(count // len(KINDS) + 1) for k in rng.permutation(KINDS)][:count]
    offset = {k: int(rng.integers(1000)) for k in sorted(set(KINDS))}
    return [(str(k), offset[k] + kinds[:i].count(k)) for i, k in enumerate(kinds)]


def rows(case, rng):
    """Return the table as {column: texts} with noise; now and then an outlier, lost cells, a column nobody kept."""
    scene, sight = case.rig.scene, case.rig.see()
    n = len(scene.time)
    x = sight.x + scene.sigma * rng.normal(size=(n, 3))
    R = sight.R @ turn((scene.sigma_turn or 0.0) * rng.normal(size=(n, 3)))
    wild = rng.choice(n, size=int(rng.integers(1, 3)), replace=False) if rng.random() < 0.3 else np.array([], dtype=int)
    x[wild] += (30 + 170 * rng.random()) * scene.sigma * rng.choice([-1, 1], size=(len(wild), 3))
    case.truth["outliers"] = sorted(int(i) for i in wild)
    table: dict[str, list[str]] = {}

    def put(name, values, digits):
        table[name] = [f"{v:.{digits}f}" for v in values]

    put("sample", range(n), 0)
    put("session", scene.session, 0)
    put("time_s", scene.time, 1)
    for k, name in enumerate(("q1_mm", "q2_mm", "q3_mm")):
        put(name, 1e3 * scene.drives[:, k], 5)
    put("q4_rad", scene.drives[:, 3], 8)
    for k in range(4):
        put(f"approach_q{k + 1}", scene.approach[:, k], 0)
    put("payload_kg", scene.payload, 1)
    put("truss_travel_m", scene.travel, 4)
    heat = {"melt": scene.melt, "ambient": scene.ambient, **{f"leg{i + 1}": scene.legs[:, i] for i in range(4)}}
    for name, values in {**heat, "platform": scene.platform}.items():
        put(f"{name}_degC", values, 2)
    if rng.random() < 0.2:
        for name in list(table)[11:]:
            table[name] = ["" if rng.random() < 0.01 else text for text in table[name]]
    if rng.random() < 0.15:
        del table["melt_degC"]
    for k, name in enumerate("xyz"):
        put(f"{name}_mm", 1e3 * x[:, k], 5)
    if scene.sigma_turn:
        for k, values in enumerate(Rotation.from_matrix(R).as_rotvec().T):
            put(f"r{'xyz'[k]}_rad", values, 9)
    return table


def header(scene):
    """Return what campaign.yaml says."""
    metrology = {"target": "moving_platform", "frame": "tracker"}
    if scene.stated:
        metrology["sigma_position_mm"] = float(f"{1e3 * scene.sigma:.3g}")
        metrology["sigma_rotation_rad"] = float(f"{scene.sigma_turn:.3g}") if scene.sigma_turn else None
    return {
        "robot": "pouring_robot",
        "description": "static poses of the moving platform seen by a laser tracker",
        "metrology": metrology,
        "drives": {"screw_pitch_mm": 1e3 * scene.pitch},
        "truss": {"span_m": scene.span},
        "ladle": {"tare_kg": scene.tare, "centre_of_mass_mm": [float(v) for v in np.round(1e3 * scene.com, 3)]},
        "reference_temperature_degC": scene.cold,
    }


def write(case, folder, rng):
    """Write the three files into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    table = rows(case, rng)
    with (folder / "campaign.csv").open("w", newline="") as file:
        out = csv.writer(file)
        out.writerow(table)
        out.writerows(zip(*table.values(), strict=True))
    (folder / "campaign.yaml").write_text(yaml.safe_dump(header(case.rig.scene), sort_keys=False))
    (folder / "truth.json").write_text(json.dumps(case.truth, indent=1))
