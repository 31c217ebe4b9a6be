"""A calibration in figures, ready for JSON; units are in the names."""

import dataclasses
import math
import os
import shlex
from pathlib import Path
from typing import Any

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
from pouring_robot.report.page import sentences
from pouring_robot.robot.location_figures import Figures
from pouring_robot.robot.model import RobotModel

MODEL = "calibrated.yaml"  # what the file of the calibrated model is called


def warnings_of(calibration: CalibrationFindings) -> list[str]:
    """Return what a user must know before using the result; one line each."""
    covered = (FlagCode.NO_NOISE_LEVEL, *ROW_CODES)  # by warnings of the template, and by the rows left out
    always = (FlagCode.UNREACHABLE_DRIVES, FlagCode.NOT_COMPARED)  # the first may leave out many rows
    weighty = [
        flag.message
        for flag in calibration.flags
        if flag.code in always or (flag.severity is Severity.WARNING and flag.code not in covered)
    ]
    failed, refused = calibration.fit.equations.failed.size, calibration.refused
    said = _said(
        "warnings",
        c=calibration,
        refused=_moved(calibration, refused.before, refused.after) if refused else "",
        worse=_worse(calibration),
        dropped=_dropped(calibration),
        times=_times_the_tolerances(calibration),
        failed=counted(failed, "row") if failed else "",
    )
    return [*weighty, *said]


def notes_of(calibration: CalibrationFindings) -> list[str]:
    """Return what is in order, but must be known to read the figures; one line each."""
    if not calibration.changed:
        return [*calibration.not_learned]
    lines = parameter_lines(calibration)
    held = [line.name for line in lines if line.learnt < LEARNT]
    dropped = _dropped(calibration)
    times = _times_the_tolerances(calibration)
    said = _said(
        "notes", c=calibration, held=len(held), names=some(held, 6), count=len(lines), dropped=dropped, times=times
    )
    return [*calibration.not_learned, *said]


def warnings_of_the_model(calibration: CalibrationFindings) -> list[str]:
    """Return those of the warnings and notes that a user of the calibrated model must know."""
    return _said("of_the_model", c=calibration, worse=_worse(calibration))


def _said(what: str, **known: Any) -> list[str]:
    return sentences("pouring_robot.calibration", what, **known)


def _dropped(calibration: CalibrationFindings) -> list[str]:
    return [group.name for group in calibration.candidates if group not in calibration.selection.groups]


def _worse(calibration: CalibrationFindings) -> str | None:
    """Return what is worse in held-out rows; None where they accept what was kept, by the rule for groups."""
    if acceptable(*calibration.held_out_scores):
        return None
    return _moved(calibration, *(calibration.misfit(calibration.split.test, after=a) for a in (False, True)))


def _times_the_tolerances(calibration: CalibrationFindings) -> float:
    """Return the ratio of parameters to what their tolerances say, RMS; 1 where that may be chance.

    Squares of their values over prior variances sum to chi-square, with as many degrees of freedom as variances were
    learnt by the noise that weighted the rows: under a larger one the values themselves scatter no less. Parameters
    that move in place of dropped ones scatter more. The sum is then a weighted one of chi-squares, approximated by a
    scaled one of the same mean and variance (Satterthwaite, Biometrics Bulletin 2, 1946).
    """
    lines = parameter_lines(calibration)
    squared = sum((p.value / p.prior_std) ** 2 for p in lines)
    kept, fit = slice(FRAMES, FRAMES + len(lines)), calibration.fit
    learnt = float(fit.learnt[kept].sum())
    if learnt <= 0.0:
        return 1.0
    nearer, farther = (tail(learnt, squared) < FALSE_ALARMS for tail in (scipy.special.chdtr, scipy.special.chdtrc))
    if not farther:
        return math.sqrt(squared / learnt) if nearer else 1.0
    prior, moved = fit.prior_std[kept], calibration.in_place_of_dropped[kept]
    scatter = np.eye(len(lines)) + (moved @ moved.T - fit.covariance[kept, kept]) / np.outer(prior, prior)
    mean, scale = float(np.trace(scatter)), float(np.square(scatter).sum() / np.trace(scatter))
    explained = moved.any() and scipy.special.chdtrc(mean / scale, squared / scale) >= FALSE_ALARMS
    return 1.0 if explained else math.sqrt(squared / learnt)


def _moved(calibration: CalibrationFindings, before: Misfit, after: Misfit) -> str:
    """Return the parts whose error is larger after than before, in words."""
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
            "held_out": int(split.test.size),
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
        "observability": observability(base.singular[: base.rank], calibration.split.rows.size),
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


def next_measurements(calibration: CalibrationFindings, folder: Path = Path()) -> list[str]:
    """Return what to measure next, one sentence each, for a user in whose ``folder`` the calibration is."""
    held = [line.name for line in parameter_lines(calibration) if line.learnt < LEARNT]
    wanted = held or [p.name for group in calibration.candidates for p in group.parameters]
    groups = [g.name for g in calibration.candidates if {p.name for p in g.parameters} & set(wanted)]
    present, deficient = calibration.present, calibration.rank_anywhere > calibration.base.rank
    whose = f"--robot {shlex.quote(os.path.relpath(present.definition.path))} " if present.robot else ""
    if present.layouts_file:  # only a model file names another
        whose = f"--model {shlex.quote(str(folder / MODEL))} "
    elif present.layout != RobotModel().layout:
        whose = f"--layout {shlex.quote(present.layout)} "
    ladle = _ladle(calibration)
    noise = {"sigma_mm": calibration.noise.length_m / MM, "sigma_mrad": calibration.noise.rotation_rad / MRAD}
    return _said("next", c=calibration, **noise, groups=groups, deficient=deficient, whose=whose, ladle=ladle)
