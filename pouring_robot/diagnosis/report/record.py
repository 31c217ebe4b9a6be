"""A diagnosis in figures: ``diagnosis.json``. Units are in the names."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin

from pouring_robot import __version__
from pouring_robot.diagnosis.diagnose import Diagnosis
from pouring_robot.diagnosis.parameters import NamedEffect
from pouring_robot.diagnosis.report.sentences import headline, next_lines, note_lines
from pouring_robot.diagnosis.report.summary import Summary, judged, named_parameters
from pouring_robot.diagnosis.report.words import absent_sources
from pouring_robot.mechanism.poses import MM, MRAD
from pouring_robot.robot.metrics import without_nan

Figures = dict[str, Any]


def diagnosis_figures(summary: Summary, model_file: str) -> Figures:
    """Return ``diagnosis.json``.

    Args:
        summary: what is told.
        model_file: path of the amended model file.
    """
    diagnosis = summary.diagnosis
    judgement, noise = diagnosis.judgement, diagnosis.noise
    known = diagnosis.diagnoser.library.effects
    content: Figures = {
        "format": "pouring_robot/diagnosis/1",
        "version": __version__,
        "campaign": str(diagnosis.campaign.path),
        "verdict": judgement.verdict,
        "headline": headline(summary),
        "effects": [_effect(summary, effect) for effect in summary.firm],
        "nearest": [_effect(summary, effect) for effect in summary.nearest],
        "where": summary.where.as_json(),
        "gap": {name: gap.figures() for name, gap in summary.gaps.items()},
        "untestable": [
            {
                "effect": effect,
                "story": known[effect].story,
                "missing": list(missing),
                "add": list(absent_sources(missing, diagnosis.campaign)),
            }
            for effect, missing in diagnosis.untestable.items()
        ],
        "suggested_measurements": summary.suggestion.as_list(),
        "suggestion": {k: v for k, v in summary.suggestion.as_dict().items() if k != "measurements"},
        "data_flags": [flag.to_json(diagnosis.campaign) for flag in diagnosis.flags],
        "model": model_file,
        "amended": not summary.refused,
        "reasons": list(judgement.reasons),
        "remainder": [item.as_json() for item in summary.left],
        "challenges": [
            {"effect": cause.effect, "description": found.description, "margin_nats": found.margin}
            for cause, found in zip(*judged(diagnosis), strict=True)
        ],
        "noise": {
            "position_mm": noise.position_m / MM,
            "position_source": noise.position_source,
            "rotation_mrad": noise.rotation_rad / MRAD if noise.rotation_source != "none" else None,
            "rotation_source": noise.rotation_source,
        },
        "rows": {
            "all": len(diagnosis.campaign),
            "fitted": int(diagnosis.fitted.sum()),
            "held_out": int((~diagnosis.fitted).sum()),
            "left_out_lines": [int(diagnosis.campaign.lines[row]) for row in diagnosis.outliers],
        },
        "held_out_block": diagnosis.held_out_name,
        "frames": _frames(diagnosis),
        "next": next_lines(summary),
        "notes": note_lines(summary),
    }
    # A campaign too small for held-out rows has the key all the same.
    content["gap"].setdefault("held_out", None)
    cleaned: Figures = without_nan(content)
    return cleaned


def _effect(summary: Summary, effect: NamedEffect) -> Figures:
    cause = effect.cause
    moved = np.linalg.norm(summary.moved[cause.effect], axis=1) / MM
    return {
        "effect": cause.effect,
        "alternatives": list(cause.alternatives),
        "probability": cause.probability,
        "parameters": {
            name: {"value": p.value, "std": p.std, "unit": p.parameter.unit}
            for name, p in named_parameters(summary.diagnosis, effect)
        },
        "form": cause.form,
        "story": effect.story,
        "log_evidence_nats": cause.evidence,
        "size_in_noise": cause.size,
        "moves_lip_largest_mm": float(np.nanmax(moved)) if np.isfinite(moved).any() else None,
    }


def _frames(diagnosis: Diagnosis) -> Figures:
    frames = diagnosis.after.frames
    pairs = {
        "tracker_to_fixed_platform": frames.T_tracker_base,
        "platform_to_target": frames.T_end_target,
    }
    return {
        name: {
            "translation_mm": (pose.translation / MM).tolist(),
            "rotation_vector_rad": np.asarray(pin.log3(pose.rotation)).tolist(),
        }
        for name, pose in pairs.items()
    }
