"""What limits the answer of a diagnosis, in sentences."""

from collections.abc import Iterator

import numpy as np

from pouring_robot.checks.flags import FlagCode, where
from pouring_robot.checks.stated_noise import LEAST_FACTOR
from pouring_robot.diagnosis.conclusions import Conclusions
from pouring_robot.effects.gaps import rows_without
from pouring_robot.estimation.kinds import KINDS
from pouring_robot.estimation.noise import repeats
from pouring_robot.inference.priors import WORKMANSHIP_LEVELS
from pouring_robot.inference.processes import CHANCE
from pouring_robot.inference.search import impossible_effects

_FEW_ROWS = 30
_MOST_LINES = 8


def note_lines(diagnosis: Conclusions) -> list[str]:
    """Return what limits the answer."""
    given = diagnosis.rows.conditions
    lines = list(diagnosis.notes)
    if len(diagnosis.rows) < _FEW_ROWS:
        lines.append(f"only {len(diagnosis.rows)} rows: take what is named as a hint, and measure {_FEW_ROWS} or more")
    if not diagnosis.rows.measured.framed:
        lines.append(
            "nothing was measured from outside: closures tell the shape of the robot, not where it stands, and all "
            "lengths only in proportion; what is held as drawn (places, zeros or leads) decides the rest"
        )
    if given.filled:
        lines.append(f"missing cells were filled in from their neighbours in time: {', '.join(given.filled)}")
    if not given.time_known:
        lines.append("there is no time: the order of the rows stands for it")
    if "repeats" in (diagnosis.noise[kind].source for kind in KINDS):
        lines.append(
            "the noise is not stated and comes from how far repeats of a command scatter: what changes from one repeat "
            "to the next counts as noise"
        )
        groups = repeats(diagnosis.campaign, np.flatnonzero(diagnosis.campaign.usable))
        if all((np.diff(rows) == 1).all() for rows in groups):
            lines.append(
                "all repeats follow each other: if the robot stood still in between, how well it comes back to a pose "
                "is not in that noise, and passes for an effect; then state a noise that holds it"
            )
    lines += [line for line in (diagnosis.refused, diagnosis.suggestion.failed) if line and line != diagnosis.misfit]
    besides = (FlagCode.REPEATED_ROWS, FlagCode.UNREACHABLE_DRIVES)  # their flag says what they are
    others = [row for flag in diagnosis.flags if flag.code in besides for row in flag.rows]
    wrong = np.setdiff1d(diagnosis.left_out, others)
    if wrong.size:
        lines.append(f"left out as gross errors: {where(diagnosis.campaign, wrong, _MOST_LINES)}")
    unusable = np.setdiff1d(np.flatnonzero(~diagnosis.campaign.usable), diagnosis.left_out)
    if unusable.size:
        lines.append(f"without a command or a measurement: {where(diagnosis.campaign, unusable, _MOST_LINES)}")
    for heading, rows in rows_without(diagnosis.campaign).items():
        said = f"left out, as {heading} is not known and other rows do not tell it (without that column they count)"
        lines.append(f"{said}: {where(diagnosis.campaign, rows, _MOST_LINES)}")
    effects, named = diagnosis.diagnoser.library.effects, (found.cause.effect for found in diagnosis.effects)
    by_session = [effect for effect in named if effects[effect].driver == "session"]
    if by_session and not np.isin(given.session[~diagnosis.fitted], given.session[diagnosis.fitted]).all():
        lines.append(
            f"what {', '.join(by_session)} is in {diagnosis.held_out_name}, which is held out, no other session "
            "tells; with --hold-out region the held-out rows say how much of the gap it makes"
        )
    if diagnosis.model.robot is not None:
        lines.append("no ladles.html: measured ladles are drawn of the pouring robot only")
    workmanship = workmanship_text(diagnosis)
    if workmanship and not diagnosis.mostly_workmanship:
        lines.append(f"beside it all joints are off as workmanship leaves them, {workmanship}")
    lines += [*_minor_lines(diagnosis), *_soft_lines(diagnosis), *_alike_lines(diagnosis)]
    refused = impossible_effects(diagnosis.hypothesis, diagnosis.judgement.thresholds)
    if refused:
        lines.append(
            f"{', '.join(refused)} would explain something, but only with values that nature does not allow: check the "
            "signs of what drives it (directions of gravity and of drives, temperatures, loads)"
        )
    stays = diagnosis.rows.not_told_by_commands(diagnosis.amended)
    ordered = [e for e in stays if e in effects and effects[e].driver == "time_s" and not given.time_known]
    if ordered:
        lines.append(
            f"without times nobody knows what {', '.join(ordered)} does beyond these rows: take it out of model.yaml "
            "before another command uses that"
        )
    stays = tuple(effect for effect in stays if effect not in ordered)
    if stays:
        lines.append(
            f"{', '.join(stays)} depend{'s' if len(stays) == 1 else ''} on conditions: other commands apply this part "
            "of model.yaml under what --condition or columns beside their poses say"
        )
    told = {FlagCode.OUTLIER, FlagCode.UNREACHABLE_POSE}
    by = {item.process.by for item in diagnosis.judgement.remainder}
    if diagnosis.train.position("after") < LEAST_FACTOR * diagnosis.train.position("floor") or by - {CHANCE}:
        told.add(FlagCode.NOISE_TOO_SMALL)  # what was found explains what no smooth cause did
    if diagnosis.judgement.scatters:
        told.add(FlagCode.NOISE_TOO_SMALL)  # the headline says it
    # A step, however small, tells who reads that the base drifts what else it may be: a tracker that was moved.
    always = (FlagCode.MEASUREMENT_JUMP, FlagCode.UNREACHABLE_DRIVES)
    weighty = [f for f in diagnosis.flags if f.severity == "warning" or f.code in always]
    lines += [f"data: {flag.message}" for flag in weighty if flag.code not in told]
    return lines


def workmanship_text(diagnosis: Conclusions) -> str:
    """Return by how much joints are off that no cause names, in words; "" where they are not, or nothing is named."""
    named = {found.cause.effect for found in diagnosis.effects if not found.cause.indices}
    sizes = dict[str, float]()
    levels = zip(diagnosis.diagnoser.library.workmanship.items(), diagnosis.hypothesis.levels, strict=True)
    for (effect, form), level in levels:
        if level and effect not in named:
            for p in form.parameters:
                sizes[p.unit] = max(sizes.get(p.unit, 0.0), WORKMANSHIP_LEVELS[level] * p.prior_std)
    if not (sizes and diagnosis.firm):
        return ""
    said = " and ".join(f"{size:.2g} {unit}" for unit, size in sizes.items())
    return f"by about {said} (standard deviation)"


def _minor_lines(diagnosis: Conclusions) -> list[str]:
    """Return what is fitted beside the causes, and what was for a time."""
    minor, fitted = diagnosis.judgement.minor, diagnosis.hypothesis.effects
    beside = [effect for effect in minor if effect in fitted]
    passing = [effect for effect in minor if effect not in fitted]
    why = "as they add too little or what a larger cause does if its size varies"
    lines = [f"fitted beside, but no causes, {why}: {', '.join(beside)}"] if beside else []
    if passing:
        own = f"left out of the model, {why}, and go by this campaign's own time or sessions"
        lines.append(f"{own}: {', '.join(passing)}")
    return lines


def _soft_lines(diagnosis: Conclusions) -> list[str]:
    """Return how much of the gap the load makes by soft joints beside the causes, which no model holds."""
    hypothesis, named = diagnosis.hypothesis, diagnosis.judgement.causes
    if not (named and hypothesis.unnamed):
        return []
    size = np.sqrt(hypothesis.squared_size(*hypothesis.unnamed) / len(hypothesis.problem.residual))
    said = "fitted beside, but no effect, so not in the model: what the load makes of soft joints"
    return [f"{said}, {size:.1f} times the noise"]


def _alike_lines(diagnosis: Conclusions) -> Iterator[str]:
    """Yield which single parameters of an effect would do what one at work does: lengths along one line, mostly."""
    found, hidden = diagnosis.hypothesis, diagnosis.judgement.thresholds.hidden
    single = [item for item in found.problem.explanations if item.columns.shape[1] == 1]
    for index in (k for effect in diagnosis.effects for k in effect.cause.indices if found.items[k] in single):
        own, seen = found.items[index], found.squared_size(index)
        others = [
            item for item in single if item.effect == own.effect and item.key not in found.keys and not item.one_of
        ]
        alike = [item for item in others if seen - found.explained_by(item, (index,)) < hidden]
        if alike:
            *rest, last = (item.form.removesuffix("_alone") for item in (*alike, own))
            yield f"{own.effect}: in these poses {', '.join(rest)} would do what {last} does"
