"""What the disagreement depends on: processes whose sum explains it, each in a sentence with its 95 % interval."""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from pouring_robot.diagnosis.discrepancy_processes import CYCLES, SIDE, Places, disagreements_of
from pouring_robot.diagnosis.where.free_residuals import Finding, FreeResiduals, size_text
from pouring_robot.diagnosis.where.ranks import rank_correlation
from pouring_robot.effects.condition_facts import in_words, known_facts
from pouring_robot.effects.conditions import Conditions
from pouring_robot.estimation.intervals import value_and_half_width
from pouring_robot.inference.gaussian_processes.discrepancy import Discrepancy, Summand
from pouring_robot.inference.gaussian_processes.processes import CHANCE, CONSTANT
from pouring_robot.inference.hypotheses import Hypothesis
from pouring_robot.inference.problem import Problem
from pouring_robot.inference.thresholds import Thresholds
from pouring_robot.io.units import shown_in
from pouring_robot.mechanism.arrays import rms

_MOST = 12  # processes at work together
_NOISE_ROUNDS, _NOISE_SETTLED = 3, 0.1
"""Largest relative difference between a noise and the residual of the processes: sizes are stated to two figures. More
rounds hardly help: where a process explains as well as independent errors in every row, the two alternate."""
_MONOTONE = 0.8  # rank correlation from which on something grows with a condition
_MINOR = 0.25  # of the largest place's size: less by the same condition is not reported


def dependence(data: FreeResiduals, given: Conditions, alpha: float) -> tuple[list[Finding], bool]:
    """Return what the residuals depend on, largest part first; ``alpha`` is the probability of any by noise alone.

    Also returned is whether the noise converged, see below.

    Noise alone reaches a Bayes factor of B with a probability of at most 1/B (Markov's inequality; Kerridge, 1963), so
    that the number of processes tried over B is a p-value. An unknown noise is first all that the frames leave, then
    what the processes leave. Independent errors in every row count as noise: under a smaller noise they would explain
    everything and hide all else.
    """
    for turn in itertools.count(1):
        places = Places.of(given, data.row, data.component, data.sigma, data.axes, data.drives)
        # Where there is time, the order of the rows adds nothing.
        processes = [p for p in disagreements_of(places) if p.seen and not (given.time_known and p.by == "order")]
        problem = Problem(data.cleared, data.nuisance, (), ())
        discrepancy = Discrepancy.of(Hypothesis.nothing(problem), processes)
        found = discrepancy.sum(Thresholds(alpha).evidence_of_one_in(len(processes)), _MOST)
        if settled := data.noise_known:
            break
        explained = (item.part for item in found if item.process.by != CHANCE)
        left = data.scaled(data.cleared - sum(explained, np.zeros(len(data.cleared))))
        if (settled := np.allclose(left.sigma, data.sigma, rtol=_NOISE_SETTLED)) or turn == _NOISE_ROUNDS:
            break
        data = left
    kinds: dict[tuple[str, bool, str], list[Summand]] = {}
    for item in found:
        of_drive = item.process.where in {drive.words for drive in given.robot.drives}
        period = item.length if item.process.by == CYCLES else ""  # waves of two periods have two causes
        kinds.setdefault((item.process.by, of_drive, period), []).append(item)
    findings, total = [], float(data.cleared @ data.cleared)
    for together in kinds.values():
        part = np.sum([item.part for item in together], axis=0)
        others = [item for item in found if item is not together[0]]
        rivals = [by for by in discrepancy.rivals(together[0], others) if by not in (CHANCE, together[0].process.by)]
        bounds = discrepancy.bounds(found) if together[0] is found[0] and not rivals else {}
        finding = _finding(together, given, tuple(dict.fromkeys(rivals)), bounds, data.noise.dof)
        p_value = float(min(len(processes) * np.exp(-together[0].evidence), 1.0))
        findings.append(replace(finding, p_value=p_value, share=float(part @ part) / total))
    return sorted(findings, key=lambda finding: -finding.share), settled


def _finding(
    together: list[Summand], given: Conditions, rivals: tuple[str, ...], bounds: Mapping[str, float], dof: float
) -> Finding:
    """Return what a condition does, in words, and which conditions do less (by their bounds)."""
    main = together[0]
    texts, first = [], _size(main)
    for item in together:
        if item.size >= _MINOR * main.size:
            size, turning = _size(item)
            unit, si = shown_in("rad" if turning else "m")
            value, half = value_and_half_width(size / si, rms(item.std) / si, dof)
            texts.append(f"{item.process.where} by {value.removeprefix('+')} ± {half} {unit}")
    text = f"{_opening(main, given)}: {_listed(texts)} (rms, 95 %)"
    if rivals:
        text += f"; or due to what varied with it: {', '.join(rivals)}"
    elif quiet := _quiet(given, bounds, main.process.where, *first):
        text += f"; {quiet}"
    channel = main.process.lengths[main.length][0].channel
    return Finding("condition", f"{text}.", first[0], None, channel.name, channel.turning, main.process.by, rivals)


def _size(item: Summand) -> tuple[float, bool]:
    """Return the root mean square of its movement, in m or rad, and whether its unit is rad."""
    turning = item.process.lengths[item.length][0].channel.turning
    return rms(item.movement), turning


def _opening(main: Summand, given: Conditions) -> str:
    by = main.process.by
    if by in _OPENINGS:
        return _OPENINGS[by]
    if by.startswith("own "):
        # The longest scale tried stands for longer ones, too.
        longest = main.length == next(iter(main.process.lengths))
        return f"Varies along its {by}, on a scale of {main.length}{' or more' if longest else ''}"
    if by == CYCLES:
        return f"Cycles with time, once in {main.length}"
    axes = (facts.axis(given) for facts in known_facts(given.robot).values() if facts.word == by)
    label, values = next(axes, ("", None))
    if values is None or np.ptp(values) == 0.0:
        return f"Depends on the {by}"
    low, high = np.quantile(values, [0.025, 0.975])
    rank = abs(rank_correlation(values, main.movement[:, 0]))
    unit = label.rpartition("[")[2].rstrip("]")
    return f"{'Grows' if rank > _MONOTONE else 'Changes'} with {by} from {low:.3g} to {high:.3g} {unit}"


_OPENINGS = {
    CHANCE: "Differs from row to row, following no known condition",
    CONSTANT: "A constant error",
    SIDE: "Depends on the side of approach",
    "session": "Differs between sessions",
}


def _quiet(given: Conditions, bounds: Mapping[str, float], where: str, size: float, turning: bool) -> str:
    """Return in words the upper bound of conditions that do less than the main one."""
    left_out = {"", SIDE, *untested(given)}
    words = [fact.word for fact in known_facts(given.robot).values() if fact.word not in left_out]
    less = sorted((bounds[f"{where} by {w}"], w) for w in words if bounds.get(f"{where} by {w}", np.inf) < size)
    if not less:
        return ""
    return f"no more than {size_text(less[-1][0], turning)} depends on {_listed([word for _, word in less], 'or')}"


def untested(given: Conditions) -> tuple[str, ...]:
    """Return the conditions that the campaign did not record or did not vary."""
    facts = known_facts(given.robot)
    wanted = [name for name, fact in facts.items() if fact.word]
    varied = {
        word
        for word, values in in_words(given, wanted).items()
        if np.ptp(values, axis=0).max() > 1e-9 * (1.0 + np.abs(values).max()) and (word != "time" or given.time_known)
    }
    return tuple(
        facts[name].word
        for name in wanted
        if facts[name].word not in varied and (facts[name].expected or given.value(name) is not None)
    )


def _listed(words: Sequence[str], last: str = "and") -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} {last} {words[-1]}"
