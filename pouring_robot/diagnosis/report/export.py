"""Output files of a diagnosis: metrics, amended model, report and ladles, all of them or none."""

from pathlib import Path
from typing import Any

from pouring_robot import __version__
from pouring_robot.diagnosis.conclusions import Conclusions
from pouring_robot.diagnosis.named_effects import NamedEffect
from pouring_robot.diagnosis.report.notes import note_lines
from pouring_robot.diagnosis.report.page import html_report
from pouring_robot.diagnosis.report.sentences import absent_sources, gap_sentence, headline, next_lines, worse_sentence
from pouring_robot.inference.thresholds import CHANCE_DRAWS
from pouring_robot.io.background_process import forked
from pouring_robot.io.figures import json_text, without_nan
from pouring_robot.io.files import check_folder, refuse_present, write_together
from pouring_robot.io.interrupt import stop_if_heard
from pouring_robot.io.seeds import CHANCE_SEED
from pouring_robot.io.units import MM
from pouring_robot.mechanism.poses import pose_figures
from pouring_robot.robot.model import RobotModel

_NAMES = "diagnosis.json", "model.yaml", "report.html", "ladles.html", "next.csv"
METRICS, MODEL, REPORT, LADLES, NEXT = _NAMES


def write_diagnosis(diagnosis: Conclusions, folder: Path | str, *, overwrite: bool = False) -> list[Path]:
    """Write ``diagnosis.json``, ``model.yaml``, ``report.html``, ``ladles.html`` and ``next.csv``; the metrics last.

    ``ladles.html`` is left out where no row has a whole position, and for any robot without a ladle; ``next.csv`` where
    nothing is to be measured next. Files of an earlier diagnosis are removed, except the campaign diagnosed here.
    The folder is made if it does not exist.

    Raises:
        OutputError: the folder cannot be written to, or a file is there already and ``overwrite`` is not set.
    """
    folder = check_folder(folder)
    refuse_present([folder / name for name in (METRICS, REPORT)], overwrite=overwrite)  # before the work
    files: dict[Path, bytes | str] = {}
    with forked(lambda: _plots(diagnosis)) as drawn:
        from pouring_robot.diagnosis.report.modelled_and_measured import ladle_scene
        from pouring_robot.viewer.page import page

        files[folder / MODEL] = described(diagnosis).file_text(folder)
        metrics = diagnosis_metrics(diagnosis, str(folder / MODEL))
        if scene := ladle_scene(diagnosis):
            files[folder / LADLES] = page(scene)
        pictures = drawn()
    stop_if_heard()  # libraries swallow interrupts while they are loaded
    if diagnosis.suggestion.measurements:
        files[folder / NEXT] = diagnosis.suggestion.plan_text()
    with_it = {
        LADLES: "the ladles in 3-D",
        MODEL: "the amended model",
        NEXT: "measurements to make",
        METRICS: "all figures",
    }
    links = {words: name for name, words in with_it.items() if folder / name in files or name == METRICS}
    files[folder / REPORT] = html_report(diagnosis, pictures, links)
    files[folder / METRICS] = json_text(metrics)
    read = diagnosis.campaign.path.resolve()
    earlier = [path for name in _NAMES if (path := folder / name).resolve() != read]
    return write_together(files, overwrite=overwrite, earlier=earlier)


def _plots(diagnosis: Conclusions) -> list[tuple[str, str]]:
    """Return the report's pictures; plotting takes long to import, and only the forked process needs it."""
    from pouring_robot.diagnosis.report.plots import plots

    return plots(diagnosis)


def described(diagnosis: Conclusions) -> RobotModel:
    """Return the amended model with a description of what was found and how good it is."""
    present = diagnosis.model.description
    nearest = ", ".join(e.cause.effect for e in diagnosis.nearest)
    said = [
        worse_sentence(diagnosis),
        headline(diagnosis),
        gap_sentence(diagnosis),
        f"What is attributed to {nearest} may be something unknown." if nearest and not diagnosis.refused else "",
        f"Diagnosed with {diagnosis.campaign.path.name}.",
        f"Before: {present}" if present else "",
    ]
    return diagnosis.amended.model_copy(update={"description": " ".join(part for part in said if part)})


Metrics = dict[str, Any]


def diagnosis_metrics(diagnosis: Conclusions, model_file: str) -> Metrics:
    """Return ``diagnosis.json``, which includes the path of the amended model file."""
    judgement, thresholds, frames = diagnosis.judgement, diagnosis.diagnoser.thresholds, diagnosis.final.state.frames
    known = diagnosis.diagnoser.library.effects
    content: Metrics = {
        "format": "pouring_robot/diagnosis/1",
        "version": __version__,
        "campaign": str(diagnosis.campaign.path),
        "verdict": judgement.verdict,
        "headline": headline(diagnosis),
        "effects": [_effect(diagnosis, effect) for effect in diagnosis.firm],
        "nearest": [_effect(diagnosis, effect) for effect in diagnosis.nearest],
        "where": diagnosis.where.figures(),
        "gap": {name: gap.figures() for name, gap in diagnosis.gaps.items()},
        "untestable": [
            {
                "effect": effect,
                "story": known[effect].story,
                "missing": list(missing),
                "add": list(absent_sources(missing, diagnosis.campaign)),
            }
            for effect, missing in diagnosis.untestable.items()
        ],
        "not_needed_nats": diagnosis.spare,
        "suggested_measurements": [measurement.figures() for measurement in diagnosis.suggestion.measurements],
        "suggestion": diagnosis.suggestion.figures(),
        "data_flags": [flag.figures(diagnosis.campaign) for flag in diagnosis.flags],
        "model": model_file,
        "amended": diagnosis.changed,
        "worse": diagnosis.worse,
        "reasons": list(judgement.reasons),
        "misfit": diagnosis.misfit,
        "unknown_size_in_noise": judgement.unknown_size,
        "remainder": [item.figures() for item in diagnosis.remainder],
        "challenges": [
            {"effect": cause.effect, "description": found.process.words, "margin_nats": found.margin}
            for cause, found in diagnosis.judgement.challenged
        ],
        "noise": diagnosis.noise.figures(),
        "noise_left": diagnosis.noise_left.figures() if diagnosis.noise_left else None,
        "thresholds": {
            "false_names": thresholds.false_names,
            "least_evidence_nats": thresholds.least_evidence,
            "by_chance_nats": thresholds.by_chance,  # of the best effect in this campaign by chance alone
            "draws": CHANCE_DRAWS,
            "seed": CHANCE_SEED,
            "made_within": diagnosis.diagnoser.library.made_within,
        },
        "rows": {
            "all": len(diagnosis.campaign),
            "fitted": int(diagnosis.fitted.sum()),
            "held_out": int((~diagnosis.fitted).sum()),
            "left_out_lines": [int(diagnosis.campaign.lines[row]) for row in diagnosis.left_out],
        },
        "held_out_block": diagnosis.held_out_name,
        "frames": {
            "tracker_to_fixed_platform": pose_figures(frames.T_tracker_base),
            "platform_to_target": pose_figures(frames.T_end_target),
        },
        "next": next_lines(diagnosis),
        "notes": note_lines(diagnosis),
    }
    # A campaign too small for held-out rows has the key, too.
    content["gap"].setdefault("held_out", None)
    if diagnosis.in_turn:
        content["gap"]["in_turn"] = diagnosis.in_turn.figures()
    cleaned: Metrics = without_nan(content)
    return cleaned


def _effect(diagnosis: Conclusions, effect: NamedEffect) -> Metrics:
    cause = effect.cause
    found = diagnosis.parameters_of(effect)
    together = diagnosis.in_words(effect)
    return {
        "effect": cause.effect,
        "alternatives": list(cause.alternatives),
        "probability": cause.probability if effect in diagnosis.firm else None,
        "parameters": {name: {"value": p.value, "std": p.std, "unit": p.parameter.unit} for name, p in found},
        "form": cause.form,
        "story": effect.story,
        **({"in_words": list(together)} if together else {}),
        "log_evidence_nats": cause.evidence,
        "size_in_noise": cause.size,
        "moves_lip_largest_mm": diagnosis.farthest_m(cause.effect) / MM,
    }
