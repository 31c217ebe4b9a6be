"""A calibration in figures, ready for JSON; units are in the names."""

import dataclasses
import math
import os

import numpy as np
import scipy.special

from pouring_robot.calibration.findings import (
    LEARNT,
    CalibrationFindings,
    Movement,
    combination_lines,
    group_effects,
    parameter_lines,
)
from pouring_robot.calibration.metrics import Misfit
from pouring_robot.calibration.selection import acceptable
from pouring_robot.checks.flags import ROW_CODES, FlagCode, Severity
from pouring_robot.estimation.frames.outer import FRAMES
from pouring_robot.estimation.identifiability import observability
from pouring_robot.estimation.intervals import deviations95
from pouring_robot.estimation.noise import FALSE_ALARMS
from pouring_robot.exceptions import counted, some
from pouring_robot.io.figures import without_nan
from pouring_robot.io.units import MM, MRAD
from pouring_robot.mechanism.poses import pose_figures
from pouring_robot.robot.location_figures import Figures
from pouring_robot.robot.model import RobotModel

MODEL = "calibrated.yaml"  # what the file of the calibrated model is called


def warnings_of(calibration: CalibrationFindings) -> list[str]:
    """Return what a user must know before using the result; one line each."""
    told = (FlagCode.NO_NOISE_LEVEL, *ROW_CODES)  # below, and by the rows that are left out
    weighty = (flag for flag in calibration.flags if flag.severity is Severity.WARNING and flag.code not in told)
    limits = (flag for flag in calibration.flags if flag.code is FlagCode.UNREACHABLE_DRIVES)  # may leave out many
    found = [flag.message for flag in (*limits, *weighty)]
    if calibration.refused:
        moved = _moved(calibration, calibration.refused.before, calibration.refused.after)
        found.append(
            f"rows held out refuse what was found ({', '.join(calibration.refused.groups)}): {moved}; it is not in the "
            "model, which is unchanged: what is off is not, or not only, geometry"
        )
    elif not calibration.changed:
        found.append("no parameter helped rows that were held out, so the model is unchanged")
    found += _not_shown(calibration)
    found += _cold(calibration)
    times = _times_the_tolerances(calibration)
    if times > 1.0:
        found.append(
            f"what was kept is {times:.1f} times as far off as its tolerances say parts are, so they hold the fit "
            "back: state what this robot's are (--tolerances)"
        )
    if calibration.inflation > 1.0:
        dropped = ", ".join(_dropped(calibration))
        or_them = f", or what was not kept ({dropped}; --keep-all keeps all)" if dropped else ""
        found.append(
            f"residuals are {calibration.inflation:.2f} times the noise: the model lacks an effect{or_them}; intervals "
            "are those of a noise as large, or of how far rows of other times move the fit where that is more; what "
            "the effect does in a pose is not in them"
        )
    if calibration.noise.from_residuals:
        said = "the noise was not stated and comes from the fit's own residuals; it cannot judge the fit"
        found.append("; ".join((said, *calibration.noise.doubts)))
    found += calibration.noise.too_large(calibration.fit.equations.components, *calibration.fit.left_over)
    if not calibration.fit.converged:
        found.append(
            f"the search ended at its limit of evaluations; what is left is {calibration.fit.last_step:.2f} standard "
            "deviations, so intervals are rough"
        )
    if failed := calibration.fit.equations.failed.size:
        found.append(f"no pose of the robot has the drives of {counted(failed, 'row')}; left out")
    return [*found, *_worse(calibration)]


def notes_of(calibration: CalibrationFindings) -> list[str]:
    """Return what is as it should be, but must be known to read the figures; one line each."""
    if not calibration.changed:
        return [*calibration.untold]
    found = [*calibration.untold, *_shown_nowhere(calibration)]
    lines = parameter_lines(calibration)
    held = [line.name for line in lines if line.learnt < LEARNT]
    if held:
        found.append(
            f"{len(held)} of {len(lines)} parameters are, each by itself, held by their tolerances ({some(held, 6)}); "
            "what the data determine of them are combinations, listed by name"
        )
    if dropped := _dropped(calibration):
        found.append(
            f"not needed to predict rows held out, so taken as exact: {', '.join(dropped)}; where they are off, what "
            "was kept moves in their place, by more than its interval says: trust the predicted pose more than the "
            "names of what moved"
        )
    return found


def _dropped(calibration: CalibrationFindings) -> list[str]:
    return [group.name for group in calibration.candidates if group not in calibration.selection.groups]


def warnings_of_the_model(calibration: CalibrationFindings) -> list[str]:
    """Return those of the warnings and notes that whoever uses the calibrated model must know."""
    nowhere = _shown_nowhere(calibration) if calibration.changed else []
    return [*_not_shown(calibration), *_cold(calibration), *_worse(calibration), *nowhere]


def _not_shown(calibration: CalibrationFindings) -> list[str]:
    unseen = calibration.rank_anywhere - calibration.base.rank
    if not calibration.changed or unseen <= 0:
        return []
    return [
        f"rank deficient: these poses do not show {unseen} of {calibration.rank_anywhere} combinations of "
        "parameters that other poses would show; tolerances alone decide along them, so do not trust the model far "
        "from the poses measured: measure the plan that is suggested next, and calibrate again"
    ]


def _shown_nowhere(calibration: CalibrationFindings) -> list[str]:
    names = calibration.base.names
    never = len(names) - calibration.rank_anywhere
    if not never:
        return []
    seen, some = calibration.campaign.seen, f"{never} of {len(names)} directions (outer frames included) move"
    shared = "tolerances share the movement out among the names that are tied together"
    if seen in ("distances", "closures"):  # nobody has asked which others would show them
        return [f"rank deficient: {some} none of the {seen} measured; {shared}"]
    nowhere = f"the {seen.removesuffix('s')} of the target nowhere in the workspace"
    more = "no further measurement tells them and predicting the target needs none of them"
    return [f"rank deficient by nature: {some} {nowhere}; {more}; {shared}"]


def _cold(calibration: CalibrationFindings) -> list[str]:
    line = (
        "the heat section of the model took no part, it stays in the file as it was: right if the robot was cold "
        "when it was measured; if it was warm, its growth is in the geometry now and must not be counted again"
    )
    return [line] if calibration.present.heat is not None else []


def _worse(calibration: CalibrationFindings) -> list[str]:
    """Return that the held-out rows do not bear what was kept, as they are asked where groups are chosen."""
    if acceptable(*calibration.held_out_scores):
        return []
    worse = _moved(calibration, *(calibration.misfit(calibration.split.test, after=a) for a in (False, True)))
    return [f"worse on held-out rows{f': {worse}' if worse else ', row by row'}; do not use this model"]


def _times_the_tolerances(calibration: CalibrationFindings) -> float:
    """Return how many times as far off parameters are as tolerances say, RMS; 1 where that is no accident.

    Squares of their values over prior variances are chi-square, of as many degrees as variances were learnt by the
    noise that weighed the rows: under a larger one the values themselves scatter no less.
    """
    lines = parameter_lines(calibration)
    squared = sum((p.value / p.prior_std) ** 2 for p in lines)
    learnt = float(calibration.fit.learnt[FRAMES : FRAMES + len(lines)].sum())
    surprising = learnt > 0.0 and scipy.special.chdtrc(learnt, squared) < FALSE_ALARMS
    return math.sqrt(squared / learnt) if surprising else 1.0


def _moved(calibration: CalibrationFindings, before: Misfit, after: Misfit) -> str:
    """Return the parts whose error after is more than that before, in words."""
    lines = "distance" if calibration.campaign.distance_m is not None else "closure"
    parts = [
        ("rotation", "mrad", before.rms_mrad, after.rms_mrad),
        (lines, "mm", before.line_rms_mm, after.line_rms_mm),
    ]
    if np.isfinite(before.axis_rms_mm).any():  # else they are of lines
        parts.insert(0, ("position", "mm", before.rms_mm, after.rms_mm))
    return ", ".join(f"{name} {b:.4g} to {a:.4g} {unit}" for name, unit, b, a in parts if a > b)


def calibration_metrics(calibration: CalibrationFindings) -> Figures:
    """Return everything found."""
    split, fit = calibration.split, calibration.fit
    test = np.setdiff1d(split.test, calibration.left_out)
    content = {
        "format": "pouring_robot/calibration/1",
        "status": "calibrated" if calibration.changed else "unchanged",
        "rank_deficient": calibration.base.deficient,
        "warnings": warnings_of(calibration),
        "notes": notes_of(calibration),
        "campaign": str(calibration.campaign.path),
        "rows": {
            "all": len(calibration.campaign),
            "train": int(split.train.size),
            "held_out": int(test.size),
            "left_out_lines": [int(calibration.campaign.lines[row]) for row in calibration.left_out],
            "not_closing": int(fit.equations.failed.size),
        },
        "held_out_by": split.kind,
        "held_out_block": split.test_name,
        "noise": calibration.noise.figures(),
        "gap": {
            name: {
                "before": dataclasses.asdict(calibration.misfit(rows, after=False)),
                "after": dataclasses.asdict(calibration.misfit(rows, after=True)),
                "floor": calibration.floor(rows),
            }
            for name, rows in (("train", split.train), ("held_out", split.test))
        },
        "iso_9283": calibration.performance and dataclasses.asdict(calibration.performance),
        "groups": [dataclasses.asdict(line) for line in group_effects(calibration)],
        "refused": calibration.refused and dataclasses.asdict(calibration.refused),
        "candidates": [group.name for group in calibration.candidates],
        "selection": [dataclasses.asdict(step) for step in calibration.selection.steps],
        "parameters": _parameters(calibration),
        "frames": {
            "tracker_to_fixed_platform": pose_figures(fit.unknowns.frames.T_tracker_base),
            "platform_to_target": pose_figures(fit.unknowns.frames.T_end_target),
        },
        "combinations": [
            {"combination": line.name, **_in_unit(line, "value", "std", "prior_std"), "moved": line.moved}
            for line in combination_lines(calibration)
        ],
        "base_parameters": _base(calibration),
        "correlation": {
            "names": list(calibration.base.names[FRAMES:]),
            "matrix": np.round(calibration.correlation[FRAMES:, FRAMES:], 6).tolist(),
        },
        "ladle": _ladle(calibration),
        "fit": _fit(calibration),
        "data_flags": [flag.figures(calibration.campaign) for flag in calibration.flags],
        "next": next_measurements(calibration),
    }
    return dict(without_nan(content))


def _parameters(calibration: CalibrationFindings) -> list[Figures]:
    return [
        {
            "name": line.name,
            "group": line.group,
            **_in_unit(line, "value", "std", "low95", "high95", "prior_std"),
            "learnt": line.learnt,
            "verdict": line.verdict,
        }
        for line in parameter_lines(calibration)
    ]


def _fit(calibration: CalibrationFindings) -> Figures:
    fit = calibration.fit
    return {
        "evaluations": fit.evaluations,
        "second_derivative_evaluations": fit.second_evaluations,
        "converged": fit.converged,
        "chi_square": fit.chi_square(),
        "freedom": fit.dof(),
        "inflation": calibration.inflation,
    }


def _in_unit(line: Movement, *names: str) -> Figures:
    figures = dataclasses.asdict(line) | dict(zip(("low95", "high95"), line.interval, strict=True))
    return {f"{name}_{line.unit}": figures[name] for name in names}


def _base(calibration: CalibrationFindings) -> Figures:
    base = calibration.base
    return {
        "unknowns": len(base.names),
        "rank": base.rank,
        "rank_with_poses_all_over_the_workspace": calibration.rank_anywhere,
        "base": list(base.base),
        "unseen": list(base.unseen),
        "dependent_groups": [
            {"members": list(g.members), "identifiable": list(g.texts()), "hidden_directions": g.hidden}
            for g in base.groups
        ],
        "observability": observability(base.singular[: base.rank], int(calibration.split.train.size)),
    }


def _ladle(calibration: CalibrationFindings) -> Figures:
    ladle = calibration.ladle
    if not len(ladle.position_m):
        return {"poses": 0}
    half, noise = ladle.half_width_m / MM, deviations95(ladle.dof) * calibration.noise.length_m / MM
    measured = float(np.median(calibration.ladle_measured.half_width_m)) / MM
    worst = int(np.argmax(half))
    pose = dict(zip(("x_mm", "y_mm", "z_mm"), (ladle.position_m[worst] / MM).tolist(), strict=True))
    if ladle.tilt_rad is not None:
        pose["tilt_deg"] = math.degrees(ladle.tilt_rad[worst])
    return {
        "poses": len(half),
        "axes": "tracker" if ladle.located else "base",
        "half_width95_mm": {"median": float(np.median(half)), "largest": float(half.max()), "where_measured": measured},
        "with_noise95_mm": {"median": float(np.median(np.hypot(half, noise)))},
        "worst_pose": pose,
    }


def next_measurements(calibration: CalibrationFindings) -> list[str]:
    """Return what to measure next, one sentence each."""
    found = []
    held = [line.name for line in parameter_lines(calibration) if line.learnt < LEARNT]
    wanted = held or [p.name for group in calibration.candidates for p in group.parameters]
    groups = [g.name for g in calibration.candidates if {p.name for p in g.parameters} & set(wanted)]
    noise, present = calibration.noise, calibration.present
    tool, _ = present.definition.tool_words
    seen = "--position-only" if not noise.turned else f"--sigma-mrad {noise.rotation_rad / MRAD:.3g}"
    deficient = calibration.rank_anywhere > calibration.base.rank
    purpose = "determine what is still open" if deficient else "narrow the intervals most"
    whose = f"--robot {os.path.relpath(present.definition.path)} " if present.robot else ""
    if present.layouts_file:  # only a model file names another
        whose = f"--model {MODEL} "
    elif present.layout != RobotModel().layout:
        whose = f"--layout {present.layout} "
    if not calibration.campaign.redundant_drives:
        found.append(
            f"poses that {purpose}: pouring-robot campaign plan {whose}--out next.csv --priors "
            f"--sigma-mm {noise.length_m / MM:.3g} {seen} --parameters " + " --parameters ".join(groups)
        )
    elif deficient:
        found.append(f"other poses, that {purpose} of {', '.join(groups)}")
    ladle = _ladle(calibration)
    if ladle["poses"]:
        pose = ladle["worst_pose"]
        tilt = f", tilt {pose['tilt_deg']:z.0f}°" if "tilt_deg" in pose else ""
        found.append(
            f"{tool} is known least at x {pose['x_mm']:z.0f}, y {pose['y_mm']:z.0f}, z {pose['z_mm']:z.0f} mm{tilt}: "
            f"measure there (95 % interval ±{ladle['half_width95_mm']['largest']:.3f} mm)"
        )
    if calibration.performance is None:
        found.append("no pose was measured three times: repeat some, to know the repeatability and the noise")
    if calibration.campaign.seen == "positions":
        found.append("only positions were measured: full poses tell axes from centres with fewer rows")
    if calibration.inflation > 1.0:
        found.append("residuals exceed the noise: run pouring-robot diagnose on this campaign to name what is missing")
    return found
