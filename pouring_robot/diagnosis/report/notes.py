"""What limits the answer of a diagnosis, in sentences."""

from collections.abc import Iterator

import numpy as np

from pouring_robot.checks.flags import FlagCode, where
from pouring_robot.diagnosis.conclusions import Conclusions
from pouring_robot.effects.missing_cells import rows_without
from pouring_robot.estimation.kinds import KINDS
from pouring_robot.estimation.noise import LEAST_FACTOR, repeats
from pouring_robot.inference.gaussian_processes.processes import CHANCE
from pouring_robot.inference.priors import WORKMANSHIP_LEVELS
from pouring_robot.inference.search import impossible_effects
from pouring_robot.mechanism.arrays import Indices

_FEW_ROWS = 30
_MOST_LINES = 8


def note_lines(diagnosis: Conclusions) -> list[str]:
    """Return what limits the answer."""
    said = (diagnosis.refused, diagnosis.suggestion.failed)
    return [
        *diagnosis.notes,
        *_measured_lines(diagnosis),
        *_too_large_lines(diagnosis),
        *_repeat_lines(diagnosis),
        *(line for line in said if line and line != diagnosis.misfit),
        *_left_out_lines(diagnosis),
        *_fitted_lines(diagnosis),
        *_elsewhere_lines(diagnosis),
        *_data_lines(diagnosis),
    ]


def _measured_lines(diagnosis: Conclusions) -> Iterator[str]:
    """Yield what was not measured."""
    rows, given = len(diagnosis.rows), diagnosis.rows.conditions
    if rows < _FEW_ROWS:
        yield f"only {rows} rows: take what is named as a hint, and measure {_FEW_ROWS} or more"
    if not diagnosis.rows.measured.framed:
        yield (
            "nothing was measured from outside: closures show the shape of the robot, but not where it stands, and "
            "only ratios of lengths; what is kept as drawn (places, zeros or leads) fixes the rest"
        )
    if given.filled:
        yield f"missing cells were filled in from their neighbours in time: {', '.join(given.filled)}"
    if not given.time_known:
        yield "no times are given: the order of the rows is used instead"


def _too_large_lines(diagnosis: Conclusions) -> list[str]:
    """Return which stated noise is much larger than the residual."""
    left, component = diagnosis.hypothesis, diagnosis.after.fitted_rows.component
    return diagnosis.rows.noise.too_large(component, left.remainder, left.freedom)


def _repeat_lines(diagnosis: Conclusions) -> Iterator[str]:
    """Yield what a noise from repeats includes, and what not."""
    if "repeats" not in (diagnosis.noise[kind].source for kind in KINDS):
        return
    yield (
        "the noise is not stated and is estimated from how far repeats of a command scatter: whatever changes from one "
        "repeat to the next counts as noise"
    )
    groups = repeats(diagnosis.campaign, np.flatnonzero(diagnosis.campaign.usable))
    if all((np.diff(rows) == 1).all() for rows in groups):
        yield (
            "all repeats follow each other: if the robot stood still in between, that noise does not include its "
            "repeatability, which then looks like an effect; in that case state a noise that includes it"
        )


def _left_out_lines(diagnosis: Conclusions) -> Iterator[str]:
    """Yield which rows took no part, what no other rows determine, and what is not drawn."""

    def these(rows: Indices) -> str:
        return where(diagnosis.campaign, rows, _MOST_LINES)

    besides = (FlagCode.REPEATED_ROWS, FlagCode.UNREACHABLE_DRIVES)  # they have flags of their own
    others = [row for flag in diagnosis.flags if flag.code in besides for row in flag.rows]
    wrong = np.setdiff1d(diagnosis.left_out, others)
    if wrong.size:
        yield f"left out as gross errors: {these(wrong)}"
    unusable = np.setdiff1d(np.flatnonzero(~diagnosis.campaign.usable), diagnosis.left_out)
    if unusable.size:
        yield f"without a command or a measurement: {these(unusable)}"
    for heading, rows in rows_without(diagnosis.campaign).items():
        said = f"left out, as {heading} is missing and not known from other rows (without that column they count)"
        yield f"{said}: {these(rows)}"
    effects, session = diagnosis.diagnoser.library.effects, diagnosis.rows.conditions.session
    by_session = [e.cause.effect for e in diagnosis.effects if effects[e.cause.effect].driver == "session"]
    if by_session and not np.isin(session[~diagnosis.fitted], session[diagnosis.fitted]).all():
        yield (
            f"no other session shows what {', '.join(by_session)} is in {diagnosis.held_out_name}, which is held out "
            "(a value for it is from its own rows); with --hold-out region the held-out rows show how much of the gap "
            "it causes"
        )
    if diagnosis.model.robot is not None:
        yield "no ladles.html: measured ladles are drawn for the pouring robot only"
    elif not diagnosis.campaign.position_measured.all(axis=1).any():
        yield "no ladles.html: no row has a complete measured position"


def _fitted_lines(diagnosis: Conclusions) -> Iterator[str]:
    """Yield what else is fitted or would explain something."""
    workmanship = workmanship_text(diagnosis)
    if workmanship and not diagnosis.mostly_workmanship:
        yield f"in addition, workmanship: all joints are off {workmanship}"
    yield from _minor_lines(diagnosis)
    yield from _soft_lines(diagnosis)
    yield from _alike_lines(diagnosis)
    refused = impossible_effects(diagnosis.hypothesis, diagnosis.judgement.thresholds)
    if refused:
        yield (
            f"{', '.join(refused)} would explain something, but only with physically impossible values: check the "
            "signs of its inputs (directions of gravity and of drives, temperatures, loads)"
        )


def _elsewhere_lines(diagnosis: Conclusions) -> Iterator[str]:
    """Yield how other commands can use the amended model."""
    effects, timed = diagnosis.diagnoser.library.effects, diagnosis.rows.conditions.time_known
    stays = diagnosis.rows.not_told_by_commands(diagnosis.amended)
    ordered = [e for e in stays if e in effects and effects[e].driver == "time_s" and not timed]
    if ordered:
        yield (
            f"without times it is unknown what {', '.join(ordered)} does beyond these rows: remove it from model.yaml "
            "before another command uses that file"
        )
    stays = tuple(effect for effect in stays if effect not in ordered)
    if stays:
        yield (
            f"{', '.join(stays)} depend{'s' if len(stays) == 1 else ''} on conditions: other commands apply this part "
            "of model.yaml only under conditions given by --condition or in columns beside the poses"
        )


def _data_lines(diagnosis: Conclusions) -> Iterator[str]:
    """Yield findings of the data checks that nothing else says."""
    said = {FlagCode.OUTLIER, FlagCode.UNREACHABLE_POSE}
    by = {item.process.by for item in diagnosis.judgement.remainder}
    if diagnosis.train.position("after") < LEAST_FACTOR * diagnosis.train.position("floor") or by - {CHANCE}:
        said.add(FlagCode.NOISE_TOO_SMALL)  # what was found explains what no smooth cause did
    if diagnosis.judgement.scatters:
        said.add(FlagCode.NOISE_TOO_SMALL)  # the headline says it
    # A step, however small, shows the reader of a base drift that the tracker may have moved instead.
    always = (FlagCode.MEASUREMENT_JUMP, FlagCode.UNREACHABLE_DRIVES, FlagCode.NOT_COMPARED)
    weighty = [f for f in diagnosis.flags if f.severity == "warning" or f.code in always]
    yield from (f"data: {flag.message}" for flag in weighty if flag.code not in said)


def workmanship_text(diagnosis: Conclusions) -> str:
    """Return how large the joint errors are that no cause names, in words; "" if there are none or nothing is named."""
    named = {found.cause.effect for found in diagnosis.effects if not found.cause.indices}
    sizes = dict[str, float]()
    levels = zip(diagnosis.diagnoser.library.workmanship.items(), diagnosis.final.hypothesis.levels, strict=True)
    for (effect, form), level in levels:
        if level and effect not in named:
            for p in form.parameters:
                sizes[p.unit] = max(sizes.get(p.unit, 0.0), WORKMANSHIP_LEVELS[level] * p.prior_std)
    if not (sizes and diagnosis.firm):
        return ""
    said = " and ".join(f"{size:.2g} {unit}" for unit, size in sizes.items())
    return f"by about {said} (standard deviation)"


def _minor_lines(diagnosis: Conclusions) -> list[str]:
    """Return what is fitted together with the causes, and what was but is left out of the model."""
    minor, fitted = diagnosis.judgement.minor, diagnosis.hypothesis.effects
    together = [effect for effect in minor if effect in fitted]
    passing = [effect for effect in minor if effect not in fitted]
    why = "as they add too little, or only what a larger cause does if its size varies"
    lines = [f"also fitted, but not named, {why}: {', '.join(together)}"] if together else []
    if passing:
        own = f"left out of the model, {why}, and depend on this campaign's own time or sessions"
        lines.append(f"{own}: {', '.join(passing)}")
    return lines


def _soft_lines(diagnosis: Conclusions) -> list[str]:
    """Return how much of the gap is deflection of compliant joints under load, which no model includes."""
    hypothesis, named = diagnosis.hypothesis, diagnosis.judgement.causes
    if not (named and hypothesis.unnamed):
        return []
    size = np.sqrt(hypothesis.squared_size(*hypothesis.unnamed) / len(hypothesis.problem.residual))
    said = "also fitted, but no effect, so not in the model: soft joints that yield under the load"
    return [f"{said}, {size:.1f} times the noise"]


def _alike_lines(diagnosis: Conclusions) -> Iterator[str]:
    """Yield which single parameters of an effect would do what one at work does, mostly lengths along one line."""
    found, hidden = diagnosis.hypothesis, diagnosis.judgement.thresholds.hidden
    single = [item for item in found.problem.explanations if item.columns.shape[1] == 1]
    for index in (k for effect in diagnosis.effects for k in effect.cause.indices if found.items[k] in single):
        own, squared = found.items[index], found.squared_size(index)
        others = [
            item for item in single if item.effect == own.effect and item.key not in found.keys and not item.one_of
        ]
        alike = [item for item in others if squared - found.explained_by(item, (index,)) < hidden]
        if alike:
            *rest, last = (item.form.removesuffix("_alone") for item in (*alike, own))
            yield f"{own.effect}: in these poses {', '.join(rest)} would have the same effect as {last}"
