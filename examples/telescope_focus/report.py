"""The report of a diagnosis, as a mapping for ``--json`` and as text."""

from __future__ import annotations

from typing import Any

import numpy as np

from pouring_robot.mechanism.arrays import FloatArray

from .data import FIRST_FILE, SECOND_FILE, FocusRows, together
from .findings import Findings, least_squares, night_name, repeats_um
from .model import STORIES, effect_forms
from .plan import Plan, propose, with_conditions
from .unknown_noise import Key

ALIKE = 3.0
"""Log evidence under which two effects cannot be told apart, in nats: odds of 20."""
_EXPOSURES = 8
_LOWEST_DEG, _HIGHEST_DEG = 25.0, 85.0


def report(first: FocusRows, second: FocusRows) -> dict[str, Any]:
    """Return the whole diagnosis: of the first campaign, checked on the second, and of both together.

    Raises:
        DiagnosisError: the rows are too few or too alike.
    """
    flags = [
        f"{int((~rows.complete).sum())} of {len(rows)} rows of {name} lack elevation, azimuth and mirror temperature: "
        "they only check what was found"
        for name, rows in ((FIRST_FILE, first), (SECOND_FILE, second))
        if not rows.complete.all()
    ]
    found = Findings(first.only(first.complete))
    both = Findings(together(found.rows, second.only(second.complete)))
    return {
        **_diagnosis(found),
        "gap": {"train": _steps(found), "held_out": _held_out(found, second)},
        "noise": _noise(found),
        "suggested_measurements": _suggested(found),
        "both_campaigns": _diagnosis(both) | {"gap": {"train": _steps(both)}, "noise": _noise(both)},
        "data_flags": flags,
    }


def _diagnosis(found: Findings) -> dict[str, Any]:
    named = [_effect(found, key) for key in found.causes]
    nights = [
        {"night": night_name(key), "evidence_nats": found.worth(key), "offset": found.parameters(key)["offset"]}
        | {"rows": int((found.forms[key].columns > 0.0).sum()), "instead": _instead(found, key)[:1]}
        for key in found.nights
    ]
    left = found.structures(found.keys)
    verdict = "named" if named else "no_gap"
    if any(effect["alternatives"] for effect in named):
        verdict = "group"
    if nights or left:
        verdict = "unknown"
    return {
        "verdict": verdict,
        "effects": named,
        "unknown": {
            "nights": nights,
            "depends_on": _described(found.structures(found.causes)),
            "left_after_nights": _described(left),
        },
        "undecided": _undecided(found),
        "untestable": found.untestable,
    }


def _effect(found: Findings, key: Key) -> dict[str, Any]:
    instead = _instead(found, key)
    return {
        "effect": key[0],
        "form": key[1],
        "story": STORIES[key[0]],
        "probability": found.probability(key),
        "evidence_nats": found.worth(key),
        "alternatives": sorted({item["effect"] for item in instead if item["nats"] > -ALIKE}),
        "parameters": found.parameters(key),
        "instead": instead[:1],
    }


def _instead(found: Findings, key: Key) -> list[dict[str, Any]]:
    return [{"effect": other[0], "form": other[1], "nats": better} for other, better in found.instead(key)]


def _described(pairs: list[tuple[str, float]]) -> list[dict[str, Any]]:
    return [{"description": name, "evidence_nats": value} for name, value in pairs]


def _undecided(found: Findings) -> list[dict[str, Any]]:
    rows = []
    for key, evidence, fit, reach in found.undecided():
        form = found.forms[key]
        values, std = fit.values, np.sqrt(np.diag(fit.covariance))
        parameters = {
            name: {"value": float(values[k]), "std": float(std[k]), "unit": form.units[k]}
            for k, name in enumerate(form.names)
        }
        row = {"effect": key[0], "form": key[1], "evidence_nats": evidence, "parameters": parameters, "up_to_um": reach}
        if len(form.names) == 1:
            alike = {
                other[0]: found.likeness(key, other)
                for other in found.causes
                if found.forms[other].columns.shape[1] == 1
            }
            row["cosine_with_named"] = alike
        rows.append(row)
    return rows


def _steps(found: Findings) -> list[dict[str, Any]]:
    table = []
    for keys, fit in found.steps():
        std, place, parameters = np.sqrt(np.diag(fit.covariance)), 0, {}
        for key in keys:
            form = found.forms[key]
            for name, unit in zip(form.names, form.units, strict=True):
                value = {"value": float(fit.values[place]), "std": float(std[place]), "unit": unit}
                parameters[f"{key[0]}: {name}"] = value
                place += 1
        table.append({"with": [key[0] for key in keys], "residual_std_um": fit.std_um, "parameters": parameters})
    return table


def _held_out(found: Findings, second: FocusRows) -> dict[str, Any] | None:
    """Say what the named effects leave of the second campaign; only its own zero of focus is fitted there."""
    if not found.causes:
        return None
    usable = second
    if not set(found.causes) <= set(effect_forms(second)):
        usable = second.only(second.complete)
    known = effect_forms(usable)
    if len(usable) < 2 or not set(found.causes) <= set(known):
        return None
    predicted = np.zeros(len(usable))
    for key in found.causes:
        values = [p["value"] for p in found.parameters(key).values()]
        predicted += known[key].columns @ np.array(values, dtype=float)
    before = least_squares(usable, []).left
    after = before - (predicted - predicted.mean())
    return {
        "file": SECOND_FILE,
        "rows": len(usable),
        "before_std_um": float(before.std(ddof=1)),
        "after_std_um": float(after.std(ddof=1)),
        "least_with_own_slopes_um": least_squares(usable, [known[key].columns for key in found.causes]).std_um,
    }


def _noise(found: Findings) -> dict[str, Any]:
    mean, std = found.core.noise(found.keys)
    repeats, pairs = repeats_um(found.rows, found.fit(found.keys).left)
    return {
        "method": "integrated over, scale-free prior",
        "mean_um": mean,
        "std_um": std,
        "repeats_um": repeats if pairs else None,
        "repeat_pairs": pairs,
    }


def _suggested(found: Findings) -> list[dict[str, Any]]:
    taken = {key[0] for key in found.causes}
    offset = max((abs(float(found.parameters(k)["offset"]["value"])) for k in found.nights), default=found.noise_um)
    suggested = []
    if "elevation_flexure" not in taken:
        angles = np.arange(_LOWEST_DEG, _HIGHEST_DEG + 1.0, 5.0)
        low, high = float(found.rows.truss_degc.min()), float(found.rows.truss_degc.max())
        plans = [
            propose(
                found,
                ("elevation_flexure", "sine and cosine"),
                with_conditions(found.rows, len(angles), elevation_deg=angles, truss_degc=truss),
                _EXPOSURES,
                night_std_um=offset,
            )
            for truss in np.linspace(low, high, 3)
        ]
        best = max(plans, key=lambda plan: plan.nats)
        suggested.append(
            _plan("elevation_flexure", best, "elevation_deg", best.rows.elevation_deg)
            | {"truss_degc": float(best.rows.truss_degc[0]), "one_night": True}
            | {"nats_by_truss_degc": {f"{p.rows.truss_degc[0]:.1f}": p.nats for p in plans}}
        )
    if "mirror_expansion" not in taken:
        apart = np.array([-4.0, -2.0, 0.0, 2.0, 4.0])
        truss = float(np.median(found.rows.truss_degc))
        candidates = with_conditions(found.rows, len(apart), mirror_degc=truss + apart, truss_degc=truss)
        plan = propose(found, ("mirror_expansion", "linear"), candidates, _EXPOSURES, night_std_um=0.0)
        suggested.append(
            _plan("mirror_expansion", plan, "mirror_minus_truss_k", plan.rows.mirror_degc - plan.rows.truss_degc)
            | {"truss_degc": truss, "one_night": False}
        )
    return suggested


def _plan(effect: str, plan: Plan, name: str, values: FloatArray) -> dict[str, Any]:
    times = {f"{value:g}": int((values == value).sum()) for value in np.unique(values)}
    return {
        "decides": effect,
        "exposures": {name: times},
        "expected_information_nats": plan.nats,
        "ordinary_exposures_nats": plan.ordinary_nats,
        "change_std_um": {"now": plan.now, "then": plan.then, "with_ordinary_exposures": plan.ordinary},
    }


def as_text(result: dict[str, Any]) -> str:
    """Return the report for people."""
    lines = [f"Verdict: {result['verdict']}", "", f"{FIRST_FILE}, constant focus and one effect more at a time:"]
    lines += _step_lines(result["gap"]["train"])
    lines += ["", *_finding_lines(result), "", *_undecided_lines(result["undecided"])]
    lines += ["", *_noise_lines(result["noise"]), *_held_out_lines(result["gap"]["held_out"])]
    lines += ["", "To measure next:", *(_plan_line(plan) for plan in result["suggested_measurements"])]
    both = result["both_campaigns"]
    lines += ["", f"Both campaigns together (rows with all conditions, a zero of focus for each): {both['verdict']}"]
    lines += [*_step_lines(both["gap"]["train"]), *_finding_lines(both)]
    lines += _changed_lines(result, both)
    lines += ["", *(f"Note: {flag}" for flag in result["data_flags"])]
    return "\n".join(lines).rstrip()


def _step_lines(steps: list[dict[str, Any]]) -> list[str]:
    lines = []
    for step in steps:
        values = ", ".join(f"{name} {_value(p)}" for name, p in step["parameters"].items())
        lines.append(f"  left {step['residual_std_um']:6.0f} µm  {values or 'constant only'}")
    return lines


def _finding_lines(result: dict[str, Any]) -> list[str]:
    lines = []
    for effect in result["effects"]:
        values = ", ".join(f"{name} {_value(p)}" for name, p in effect["parameters"].items())
        shown = min(effect["probability"], 0.9999)
        lines.append(f"Named: {effect['effect']} ({effect['story']}): {values}; probability {shown:.4f}")
        lines += [f"  in its place {_other(item)}" for item in effect["instead"]]
        if effect["alternatives"]:
            lines.append(f"  cannot be told from: {', '.join(effect['alternatives'])}")
    for night in result["unknown"]["nights"]:
        off = f"the night {night['night']} ({night['rows']} rows) is off by {_value(night['offset'])}"
        lines.append(f"Unknown: {off}, cause not known; evidence {night['evidence_nats']:.1f} nats")
        lines += [f"  in its place {_other(item)}" for item in night["instead"]]
    before = result["unknown"]["depends_on"][:3]
    if before:
        lines.append("  without offsets of nights the remainder follows " + _list(before))
    left = result["unknown"]["left_after_nights"][:3]
    lines.append(
        f"After that the remainder follows {_list(left)}" if left else "After that the remainder has no structure."
    )
    return lines


def _other(item: dict[str, Any]) -> str:
    return f"{item['effect']} would be {-item['nats']:.1f} nats worse"


def _list(items: list[dict[str, Any]]) -> str:
    return ", ".join(f"{i['description'].removeprefix('focus by ')} ({i['evidence_nats']:.1f} nats)" for i in items)


def _undecided_lines(items: list[dict[str, Any]]) -> list[str]:
    lines = ["Undecided: these data neither ask for it nor rule it out."] if items else []
    for item in items:
        values = ", ".join(f"{name} {_value(p)}" for name, p in item["parameters"].items())
        alike = [
            f"; moves like {name} (cosine {c:.3f})" for name, c in item.get("cosine_with_named", {}).items() if c > 0.95
        ]
        lines.append(
            f"  {item['effect']} ({item['form']}): {values}; evidence {item['evidence_nats']:.1f} nats; "
            f"may move the focus by up to {item['up_to_um']:.0f} µm{''.join(alike)}"
        )
    return lines


def _noise_lines(noise: dict[str, Any]) -> list[str]:
    line = f"Noise: {noise['mean_um']:.0f} ± {noise['std_um']:.0f} µm, not given but integrated over"
    if noise["repeats_um"] is None:
        return [f"{line}; no repeated exposures to compare with."]
    return [f"{line}; {noise['repeat_pairs']} pairs repeated in one night say {noise['repeats_um']:.0f} µm."]


def _held_out_lines(held_out: dict[str, Any] | None) -> list[str]:
    if held_out is None:
        return ["Held out: not checked; nothing is named, or the second campaign lacks its condition."]
    before, after, own = (held_out[k] for k in ("before_std_um", "after_std_um", "least_with_own_slopes_um"))
    return [
        f"Held out, {held_out['file']} ({held_out['rows']} rows, only their zero fitted): "
        f"{before:.0f} µm before, {after:.0f} µm after; {own:.0f} µm with slopes of its own."
    ]


def _plan_line(plan: dict[str, Any]) -> str:
    (name, times), *_ = plan["exposures"].items()
    words = {"elevation_deg": "elevation {} deg", "mirror_minus_truss_k": "mirror {} K from the truss"}
    what = ", ".join(f"{words[name].format(value)} ({count} x)" for value, count in times.items())
    how = "all in one night" if plan["one_night"] else "each in another night"
    nats, ordinary = plan["expected_information_nats"], plan["ordinary_exposures_nats"]
    std, by_truss = plan["change_std_um"], plan.get("nats_by_truss_degc")
    lines = [f"  {plan['decides']}: {what}, {how}"]
    lines.append(f"    {nats:.2f} nats expected, {ordinary:.2f} from as many ordinary exposures;")
    if by_truss:
        told = ", ".join(f"{value:.3f} at {truss}" for truss, value in by_truss.items())
        lines.append(f"    truss temperature, nats: {told} °C;")
    lines.append(
        f"    what it does between the extremes of the plan is known to {std['now']:.0f} µm now, "
        f"to {std['then']:.0f} µm then, to {std['with_ordinary_exposures']:.0f} µm with ordinary exposures"
    )
    return "\n".join(lines)


def _changed_lines(alone: dict[str, Any], both: dict[str, Any]) -> list[str]:
    """Say what the second campaign changes: what one campaign alone names or leaves open may move with more data."""
    lines = []
    named = [effect["effect"] for effect in alone["effects"]]
    added = [effect["effect"] for effect in both["effects"] if effect["effect"] not in named]
    if added:
        lines.append(
            f"Together they ask for {', '.join(added)} besides; the values of one campaign alone hold without it."
        )
    off = [night["night"] for night in both["unknown"]["nights"]]
    settled = [night["night"] for night in alone["unknown"]["nights"] if night["night"] not in off]
    if settled:
        lines.append(f"Then no offset is asked for in the night{'s' * (len(settled) > 1)} {' and '.join(settled)}.")
    return lines


def _value(parameter: dict[str, Any]) -> str:
    digits = 1 if parameter["std"] < 10.0 else 0
    return f"{parameter['value']:+.{digits}f} ± {parameter['std']:.{digits}f} {parameter['unit']}"
