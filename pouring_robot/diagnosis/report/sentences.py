"""A diagnosis in sentences for the shop floor."""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

import numpy as np
from scipy.special import stdtrit

from pouring_robot.campaign.columns import approach_names
from pouring_robot.campaign.data import Campaign
from pouring_robot.campaign.metadata import FROM_THE_ROW_BEFORE
from pouring_robot.diagnosis.conclusions import Conclusions
from pouring_robot.diagnosis.cross_validation import FEWEST_VALUES
from pouring_robot.diagnosis.gap import Gap, share_closed
from pouring_robot.diagnosis.named_effects import FoundParameter, NamedEffect, sure_text
from pouring_robot.diagnosis.partial_turns import left_open
from pouring_robot.diagnosis.report.notes import note_lines, workmanship_text
from pouring_robot.diagnosis.suggest.next_measurements import NO_POSE
from pouring_robot.effects.condition_facts import INERTIAS, facts_of, sources
from pouring_robot.estimation.intervals import value_and_half_width
from pouring_robot.estimation.kinds import Kind, component_name, component_shown_in, unit_of
from pouring_robot.exceptions import counted, some
from pouring_robot.inference.decision import Cause
from pouring_robot.inference.gaussian_processes.processes import CHANCE, CONSTANT
from pouring_robot.inference.problem import WORKMANSHIP_FORM
from pouring_robot.inference.thresholds import LITTLE_NATS
from pouring_robot.io.units import MM, MRAD
from pouring_robot.robot.description.cause_types import AxisTilt

_SHOWN_PARAMETERS, _SHOWN_SENTENCES, _SHOWN_PAIRS, _SHOWN_MEASUREMENTS = 4, 5, 2, 3
_CLEAR = 2.0
_MOST_NATS_SAID = 1000.0
_TOO_LITTLE = "too little, or only if distorted or cancelled by others"
_GAP = 1.2  # how many times the noise a gap must be: a share of a smaller gap says nothing


def plain(name: str) -> str:
    """Return an id as words."""
    return name.replace("_", " ")


def headline(diagnosis: Conclusions) -> str:
    """Return the verdict in one sentence."""
    verdict = diagnosis.verdict
    if verdict == "no_gap":
        if diagnosis.noise.from_residuals:
            said = "these data show nothing that the model lacks; their noise is not stated, see the notes."
            return f"NO STRUCTURE: {said}"
        return "NO GAP: model and measurement agree within the noise."
    if verdict == "unknown":
        # A probability among the known causes would mislead.
        named = " and ".join(effect.cause.effect for effect in diagnosis.firm)
        besides = f" Also found: {named}." if named else ""
        if diagnosis.misfit:
            return f"UNKNOWN: {diagnosis.misfit}.{besides}"
        moved = diagnosis.rows.conditions.causes.words.moved
        said = scatter_text(diagnosis) or f"something that no effect of the library explains moves the {moved}"
        if size := diagnosis.judgement.unknown_size:
            said += f", by {size:.1f} times the noise"
        return f"UNKNOWN: {said}.{besides}"
    names = _names(diagnosis)
    # A reader of this sentence alone must not take the causes for the gap where joints make more of it.
    mostly = ""
    if diagnosis.mostly_workmanship:
        mostly = f" Workmanship accounts for more of the gap: all joints are off {workmanship_text(diagnosis)}."
    if verdict == "group":
        return f"ONE OF A GROUP: the model lacks {names}; this campaign cannot say which.{mostly}"
    return f"NAMED: the model lacks {names}.{mostly}"


def scatter_text(diagnosis: Conclusions) -> str:
    """Return in words as which larger noise the residual scatters from row to row; "" where it does not."""
    left = diagnosis.noise_left
    if left is None:
        return ""
    kind, which = diagnosis.noisy, "noise of "
    noise, left = diagnosis.noise.of(kind), left.of(kind)
    if kind:
        which = f"noise of the {kind}s {left[kind].sigma / noise[kind].sigma:.2g} times as large: "
    known = f"the stated {noise.words}" if np.isinf(noise.dof) else f"{noise.words} by the repeats"
    return f"the residuals scatter from row to row, like {which}{left.words} instead of {known}"


def _names(diagnosis: Conclusions) -> str:
    causes = [effect.cause for effect in diagnosis.firm]
    parts = [
        " or ".join((c.effect, *c.alternatives))
        if c.alternatives
        else f"{c.effect} ({sure_text(c.probability)}{_seldom_text(diagnosis, c)})"
        for c in causes
    ]
    return ("; and " if any(c.alternatives for c in causes) else " and ").join(parts)


def _seldom_text(diagnosis: Conclusions, cause: Cause) -> str:
    """Return that few searches without a block find a cause, in words; "" where most do, or there were none."""
    turns = diagnosis.in_turn
    if turns is None or not turns.seldom(cause):
        return ""
    return f": found in {turns.times_found(cause)} of {turns.blocks} searches that leave out a block"


def gap_sentence(diagnosis: Conclusions) -> str:
    """Return the gap before and after in one sentence: of held-out rows if there are any."""
    name, gap = diagnosis.shown_gap
    said, sizes = list[str](), _sizes(gap)
    for kind, (before, after, floor) in sizes.items():
        unit, si = unit_of(kind)
        of = "" if said else f" RMS per {gap.length if kind == 'position' else 'component'}"
        then = "" if diagnosis.refused else f" before, {after / si:.3f} {unit} after"
        said.append(f"{before / si:.3f} {unit}{of}{then}, noise {floor / si:.3f} {unit}")
    text = f"{name[0].upper()}{name[1:]}{diagnosis.noise.unseen(gap.seen)}: {'; '.join(said)}"
    if diagnosis.refused:
        return f"{text}. The model is not amended."
    return f"{text}{_closed_text(diagnosis, sizes)}.{_in_turn_text(diagnosis)}"


def _sizes(gap: Gap) -> dict[Kind, list[float]]:
    """Return the gap before and after, and the noise, in m or rad, of positions and rotations if there are any."""
    of: dict[Kind, Callable[[str], float]] = {"position": gap.position, "rotation": gap.rotation}
    sizes = {kind: [size(which) for which in ("before", "after", "floor")] for kind, size in of.items()}
    return {kind: size for kind, size in sizes.items() if math.isfinite(size[0])}


def _closed_text(diagnosis: Conclusions, sizes: Mapping[Kind, Sequence[float]]) -> str:
    """Return how much of the gap is closed, in position or else in rotation; "" where there is hardly any."""
    clear = [kind for kind, (before, _, floor) in sizes.items() if before > _GAP * floor]
    if not clear or diagnosis.verdict == "no_gap":
        return ""
    kind = clear[0]
    closed = share_closed(*sizes[kind])
    share = "all" if closed > 0.995 else "none" if closed < 0.005 else f"{100.0 * closed:.0f} %"
    return f" ({share} of the gap{f' in {kind}' if len(sizes) > 1 else ''} closed)"


def worse_sentence(diagnosis: Conclusions) -> str:
    """Return that the amended model must not be used; "" where it is no worse than the given one."""
    return "Worse on held-out rows: do not use this model." if diagnosis.worse else ""


def _in_turn_text(diagnosis: Conclusions) -> str:
    found, held_out = diagnosis.in_turn, diagnosis.held_out
    if found is None:
        alone = held_out is not None and 0 < held_out.counts.sum() < FEWEST_VALUES and diagnosis.judgement.names
        said = "no other block can be held out, as without it the poses of tracker and target are unknown"
        return f" One block of so few rows proves little; {said}." if alone else ""
    before, after = (found.gap.position(which) / MM for which in ("before", "after"))
    turn, left_turn = (found.gap.rotation(which) / MRAD for which in ("before", "after"))
    turned = f"; {turn:.3f} mrad before, {left_turn:.3f} mrad after" if math.isfinite(turn) else ""
    return (
        f" One block of so few rows proves little; with each of {found.blocks} held out in turn: {before:.3f} mm "
        f"before, {after:.3f} ± {found.error_m / MM:.3f} mm after (standard error){turned}; the same effects named in "
        f"{found.agreed} of them."
    )


def gap_table(diagnosis: Conclusions) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Return heading and rows of the gap by component, RMS in mm and mrad, tracker's axes; empty columns left out."""
    table = []
    for name, gap in diagnosis.gaps.items():
        kind = "held out" if name == "held_out" else "fitted"
        for which in ("before", "floor") if diagnosis.refused else ("before", "after", "floor"):
            values, measured = getattr(gap, which), gap.counts > 0
            cells = [*(values[:3] / MM), gap.position(which) / MM, *(values[3:6] / MRAD), gap.rotation(which) / MRAD]
            cells += (values[6:] / MM).tolist()
            known = [*measured[:3], True, *measured[3:6], True, *measured[6:]]
            shown = (f"{v:.4f}" if k and math.isfinite(v) else "" for v, k in zip(cells, known, strict=True))
            rows = str(gap.rows) if which == "before" else ""
            table.append((kind, "noise" if which == "floor" else which, *shown, rows))
    names = [f"{component_name(k)} {component_shown_in(k)[0]}" for k in range(len(gap.before))]
    head = ("rows", "", *names[:3], "all mm", *names[3:6], "all mrad", *names[6:], "count")
    kept = [k for k in range(len(head)) if any(row[k] for row in table)]
    return tuple(head[k] for k in kept), [tuple(row[k] for k in kept) for row in table]


def effect_lines(diagnosis: Conclusions, effect: NamedEffect, *, short: bool = True) -> list[str]:
    """Return an effect in sentences: what happens, how large it is, its parameters; if short, only the clearest."""
    cause, tip = effect.cause, diagnosis.rows.conditions.causes.words.tip
    lines = [
        f"{cause.effect}: {effect.story}",
        f"moves the {tip} by up to {diagnosis.farthest_m(cause.effect) / MM:.2f} mm in these poses; "
        f"without it, {cause.size:.1f} times the noise would remain",
    ]
    every = diagnosis.parameters_of(effect)
    known = diagnosis.diagnoser.library.effects[cause.effect]
    beyond = _beyond_nature(diagnosis, effect, every)
    with_care = [*known.to_read_with_care(diagnosis.rows.conditions), *left_open(diagnosis, effect), *beyond]
    if together := diagnosis.in_words(effect):  # instead of the parameters
        return [*lines, *together, *with_care]
    clear = [(name, p) for name, p in every if p.std > 0.0 and abs(p.value) > _CLEAR * p.std]
    order = sorted(
        clear or every, key=lambda item: (not item[1].parameter.main, -abs(item[1].value) / max(item[1].std, 1e-300))
    )
    shown = order[:_SHOWN_PARAMETERS]
    more = len(every) - len(shown)
    form = form_text(diagnosis, effect)
    lines.append(
        f"{form}{': ' if form else ''}{', '.join(parameter_text(*item) for item in shown)} (95 %)"
        + (f"; {more} more {'in the report' if short else 'below'}" if more else "")
    )
    if not clear:
        lines.append("together they are significant, no single value is")
    as_zeros = as_zeros_text((name for name, _ in shown), diagnosis.rows.conditions.causes.placements.tilts)
    return [*lines, *with_care, *([as_zeros] if as_zeros else [])]


def _beyond_nature(
    diagnosis: Conclusions, effect: NamedEffect, every: Iterable[tuple[str, FoundParameter]]
) -> Iterator[str]:
    """Yield which values are beyond physical limits; by chance alone only at the accepted rate of false names."""
    if all(diagnosis.hypothesis.items[k].bounds is None for k in effect.cause.indices):
        return  # a part that the given model has already may have to become smaller
    bounded = [(name, p) for name, p in every if np.isfinite(p.parameter.bounds).any()]
    rate, beyond = diagnosis.diagnoser.thresholds.false_names / len(bounded), []
    for name, found in bounded:
        slack = -float(stdtrit(found.dof, rate)) * found.std
        low, high = found.parameter.bounds
        beyond += [plain(name)] * (not low - slack <= found.value <= high + slack)
    if beyond:
        yield (
            f"physically impossible: {some(beyond, _SHOWN_PARAMETERS)}; something else acts there, or masses, loads or "
            "temperatures are not as stated"
        )


def as_zeros_text(names: Iterable[str], tilts: Sequence[AxisTilt]) -> str:
    """Return which parameters may be zeros of the preceding joints as well, in words; "" where none may."""
    zeros = {f"{tilt.joint}.tilt_{axis}": joint for tilt in tilts for axis, joint in tilt.zeros.items()}
    shared = [f"{plain(name)} (zero of {plain(zeros[name])})" for name in names if name in zeros]
    return f"may as well be the zero of the joint before: {', '.join(shared)}" if shared else ""


def form_text(diagnosis: Conclusions, effect: NamedEffect) -> str:
    """Return the form or forms of an effect in words; "" where that says nothing: workmanship, all drives."""
    at_work = [diagnosis.hypothesis.items[k].form for k in effect.cause.indices] or [effect.cause.form]
    forms = [f"'{plain(form)}'" for form in dict.fromkeys(at_work) if form not in (WORKMANSHIP_FORM, "all")]
    return f"form{'s' * (len(forms) > 1)} {', '.join(forms)}" if forms else ""


def parameter_text(name: str, found: FoundParameter) -> str:
    """Return a parameter with its 95 % half width and unit."""
    value, half = value_and_half_width(found.value, found.std, found.dof)
    return f"{plain(name)} {value} ± {half} {found.parameter.unit}"


def apart_lines(diagnosis: Conclusions) -> list[str]:
    """Return what this campaign cannot distinguish, and what would distinguish it."""
    lines = []
    for effect in diagnosis.firm:
        cause = effect.cause
        if cause.alternatives:
            group = {cause.effect, *cause.alternatives}
            lines.append(f"{', '.join((cause.effect, *cause.alternatives))} look nearly the same in this campaign")
            pairs = [s for s in diagnosis.suggestion.separations if {s.first, s.second} <= group]
            if diagnosis.suggestion.tells:
                lines += [f"  {s.first} or {s.second}: {s.how}" for s in pairs]
    return lines


def left_lines(diagnosis: Conclusions) -> list[str]:
    """Return what is left and why the verdict is ``unknown``: descriptions, not causes."""
    if diagnosis.verdict != "unknown":
        return []
    lines, judged, better = list[str](), diagnosis.judgement, dict[str, list[str]]()
    for effect in judged.doubtful:
        found = judged.beaten.get(effect)
        better.setdefault(found.process.words if found else "", []).append(effect)
    for words, effects in better.items():
        are = "are the nearest known effects" if len(effects) > 1 else "is the nearest known effect"
        better_said = f"{are} but not the cause: '{words}' describes the data better"
        said = better_said if words else "may be present, or be part of what is unknown"
        lines.append(f"{', '.join(effects)} {said}")
    opening = "in addition, " if lines else ""
    lines += [opening + item.sentence for item in diagnosis.remainder]
    lines[:0] = [line for line in (diagnosis.misfit, scatter_text(diagnosis)) if line]
    return lines or list(diagnosis.judgement.reasons)


def spare_lines(diagnosis: Conclusions) -> list[str]:
    """Return which effects were tried with the named ones and are not needed, with their log evidence."""
    spare = diagnosis.spare if diagnosis.firm and diagnosis.verdict != "unknown" else {}
    least = diagnosis.diagnoser.thresholds.least_evidence
    said = {effect: f"{effect} ({worth:+z.1f} nats)" for effect, worth in spare.items()}
    below, above = ([said[e] for e, worth in spare.items() if (worth < least) == few] for few in (True, False))
    lines = [f"{', '.join(below)}; an effect needs {least:.1f} to be named"] if below else []
    if above:
        lines.append(f"{', '.join(above)} would explain something, but {_TOO_LITTLE}")
    return lines


def absent_sources(needs: Iterable[str], campaign: Campaign) -> tuple[str, ...]:
    """Return the :func:`sources` that a campaign lacks."""
    columns = {*campaign.missing_conditions()}
    stated, wanted = campaign.metadata.stated, sources(needs, campaign.robot)
    found = tuple(name for name in wanted if name in columns or (name in stated and stated[name] is None))
    return found or wanted


def source_text(names: Sequence[str], campaign: Campaign) -> str:
    """Return in words what must be given: columns in the table, keys in its YAML, a session, masses."""
    if list(names) == ["session"] and "session" in campaign.headings:
        return f"all rows are of one session; {facts_of('session', campaign.robot).vary} in a second"
    keys = [name for name in names if "." in name]
    drawn = [name for name in names if name == INERTIAS]
    columns = [name for name in names if name not in {*keys, *drawn}]
    parts = [*drawn]
    parts += [f"column{'s' if len(columns) > 1 else ''} {', '.join(columns)}"] if columns else []
    yaml = campaign.path.with_suffix(".yaml").name
    parts += [f"{', '.join(keys)} in {yaml}"] if keys else []
    sides = not {*columns}.isdisjoint(approach_names(campaign.robot))
    key = f"drives.approach: {FROM_THE_ROW_BEFORE} in {yaml}"
    order = f", or {key} if the robot went to each pose directly from the one before" if sides else ""
    return f"add {' and '.join(parts)}{order}"


def untestable_lines(diagnosis: Conclusions) -> list[str]:
    """Return which effects this campaign cannot test, and which columns or keys are missing."""
    campaign = diagnosis.campaign
    by_source: dict[str, list[str]] = {}
    for effect, missing in diagnosis.untestable.items():
        by_source.setdefault(source_text(absent_sources(missing, campaign), campaign), []).append(effect)
    return [f"{', '.join(effects)}: {source}" for source, effects in by_source.items()]


def next_lines(diagnosis: Conclusions) -> list[str]:
    """Return what to measure or do next."""
    verdict, lines = diagnosis.verdict, []
    if diagnosis.misfit:
        lines.append("check order, units and signs of the drive columns, and that the robot file describes this robot")
    elif verdict == "unknown":
        if diagnosis.untestable:
            lines.append(f"first make testable what may be the cause: {', '.join(diagnosis.untestable)}")
        lines.append(_where_to_look(diagnosis))
    elif unweighed := _unweighed(diagnosis):
        why = "weight, too, varies with the pose, and its effect may be part of what is named"
        lines.append(f"first make testable {', '.join(unweighed)}: {why}")
    if verdict == "no_gap":
        least = diagnosis.diagnoser.thresholds.least_evidence
        worths = {f"{n} ({worth:+z.1f} nats)": worth for n, worth in diagnosis.spare.items() if worth >= LITTLE_NATS}
        near, bent = ([said for said, worth in worths.items() if (worth < least) == few] for few in (True, False))
        if near:
            said = f"{least:.1f} are needed, so measure more rows"
            lines.append(f"not certain enough to be named: {', '.join(near)}; {said}")
        lines += [f"{', '.join(bent)} would explain something, but {_TOO_LITTLE}"] if bent else []
        hidden = {s.second: s.how for s in diagnosis.suggestion.separations}
        ways = {name: "no pose shows it" if how == NO_POSE else f"to detect it, {how}" for name, how in hidden.items()}
        lines += [f"could be present but hidden: {name}; {way}" for name, way in ways.items()]
    elif not diagnosis.judgement.scatters:
        lines += _measurement_lines(diagnosis)
    unlimited = diagnosis.diagnoser.library.made_within is None
    if unlimited and diagnosis.judgement.names and diagnosis.hypothesis.coarsely_made:
        lines.append(
            "the joints look less accurate than usual, which may hide a cause; if they are known to be more accurate, "
            "state how accurate (--made-within)"
        )
    if diagnosis.noise.from_residuals:
        lines.append(
            "state the noise of the measuring device (metrology in the YAML), or measure some poses three times"
        )
    if diagnosis.held_out is None:
        lines.append("measure more poses, so that some can be held out as a check")
    return lines


def _unweighed(diagnosis: Conclusions) -> list[str]:
    """Return the effects of weight that lack masses, where a cause of drives and poses alone may stand in for them."""
    effects = diagnosis.diagnoser.library.effects
    named = (effects[found.cause.effect] for found in diagnosis.effects)
    if not any(effect.moves_robot and not effect.needs and not effect.campaign_specific for effect in named):
        return []
    untestable, robot = diagnosis.untestable.items(), diagnosis.campaign.robot
    return [effect for effect, missing in untestable if INERTIAS in sources(missing, robot)]


def _where_to_look(diagnosis: Conclusions) -> str:
    if diagnosis.judgement.scatters:
        return (
            "measure some poses three times: if repeats scatter as much, it is noise of the device, to be stated "
            "(metrology in the YAML); if not, something that changes from row to row is missing"
        )
    if any(left.slipped for left in diagnosis.remainder):
        return "check whether the target slipped or was remounted; if so, make the rows before and after two campaigns"
    words = {CONSTANT: "nothing (a constant error)"}
    by = [words.get(left.by, left.by) for left in diagnosis.remainder if left.by != CHANCE]
    if not by:
        return "measure the same poses again under other conditions: what changes shows what the error depends on"
    return (
        f"look for a cause that depends on {', or '.join(dict.fromkeys(by))}; add it as an effect of your own, or "
        "record what it may depend on in a column"
    )


def _measurement_lines(diagnosis: Conclusions) -> list[str]:
    suggestion = diagnosis.suggestion
    if not suggestion.measurements:
        return []
    pairs = list(dict.fromkeys(f"{_quoted(s.first)} from {_quoted(s.second)}" for s in suggestion.separations))
    best, shown = suggestion.best_first, some(pairs, _SHOWN_PAIRS)
    gain, now = suggestion.expected_nats, min(s.now_nats for s in suggestion.separations)
    odds = f"({LITTLE_NATS:g} nats: odds of {math.exp(LITTLE_NATS):.0f})"
    if diagnosis.verdict == "named" and gain < LITTLE_NATS <= now:
        return [
            f"no measurement is needed to distinguish {shown}: they are {now:.0f} nats apart or more, and "
            f"{counted(len(best), 'measurement')} would add {gain:.1f} {odds}"
        ]
    if not suggestion.tells:
        return [f"none of the measurements that were tried would distinguish {shown}"]
    by_chance = float(np.median(suggestion.random_nats))
    lines = [
        f"{counted(len(best), 'measurement')} to distinguish {shown}: {_nats_text(gain)} expected, "
        f"{_nats_text(by_chance)} from as many at random {odds}; the best of them:"
    ]
    return lines + [f"  {m.words}" for m in best[:_SHOWN_MEASUREMENTS]]


def _quoted(name: str) -> str:
    """Return what explains: an effect's id, or a description in words with quotes."""
    return f"'{name}'" if " " in name else name


def _nats_text(nats: float) -> str:
    """Return evidence in words; beyond any doubt, only a lower bound."""
    return f"{nats:.1f} nats" if nats < _MOST_NATS_SAID else f"more than {_MOST_NATS_SAID:g} nats"


def sections(diagnosis: Conclusions, *, short: bool = True) -> list[tuple[str, list[str]]]:
    """Return headings and lines in order of importance, if short only the most important; no empty sections."""
    where = list(diagnosis.where.sentences)
    if short and len(where) > _SHOWN_SENTENCES:
        where = [*where[:_SHOWN_SENTENCES], f"{len(where) - _SHOWN_SENTENCES} more in the report"]
    by_effect = [effect_lines(diagnosis, effect, short=short) for effect in diagnosis.firm]
    which = [line if k == 0 else f"  {line}" for lines in by_effect for k, line in enumerate(lines)]
    found = [
        ("where they disagree", [] if diagnosis.verdict == "no_gap" and short else where),
        ("which effect", which),
        ("what cannot be distinguished", apart_lines(diagnosis)),
        ("tried, and not needed", spare_lines(diagnosis)),
        ("what is left", left_lines(diagnosis)),
        ("what could not be tested", untestable_lines(diagnosis)),
        ("next", next_lines(diagnosis)),
        ("notes", note_lines(diagnosis)),
    ]
    return [(heading, lines) for heading, lines in found if lines]
