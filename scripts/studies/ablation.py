"""Ablation of the diagnosis: the same blind campaigns with one of its choices switched off at a time.

    python -m scripts.studies.ablation --wide --cases 40 --seed 90             # the repository's rig, from shop to shop
    python -m scripts.studies.ablation --folder DIR --without "bent effects"   # campaigns with truth.json, one choice
    python -m scripts.studies.ablation --arm                                   # what is said of a real arm

Each row is one choice: how many trials have the correct answer with it switched off, and which ones it lost and won
against the unchanged diagnosis. A choice whose removal loses nothing here is not shown to be needed.
"""

from __future__ import annotations

import argparse
import multiprocessing
import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np

from pouring_robot.campaign.data import Campaign
from pouring_robot.diagnosis import cross_validation, diagnoser, search_and_noise
from pouring_robot.diagnosis.discrepancy_processes import CYCLES, processes_of
from pouring_robot.diagnosis.library import known_effects
from pouring_robot.inference import decision, evidence, hypotheses, priors, problem, search
from pouring_robot.inference.gaussian_processes import discrepancy
from pouring_robot.inference.gaussian_processes.processes import CHANCE, Process
from pouring_robot.inference.thresholds import Thresholds
from scripts.benchmarks.blind_metrics import failures
from scripts.benchmarks.blind_trials import Job, campaigns, jobs, run
from tests.diagnosis.trial import Trial

diagnosing = import_module("pouring_robot.diagnosis.diagnose")
"""The module; its package has a function of that name."""


def _put(owner: object, name: str, value: object) -> None:
    """Replace something for as long as this process lives; an AttributeError where it is not there any more."""
    patch.object(owner, name, value).start()


def _no_workmanship() -> None:
    build = problem.Problem.build
    _put(problem.Problem, "build", lambda residual, free, _, items: build(residual, free, (), items))


def _no_softness() -> None:
    every = known_effects
    _put(diagnoser, "known_effects", lambda *given: (item for item in every(*given) if item.cause))


def _without_processes(by: str) -> None:
    _change_processes(lambda process: None if process.by == by else process)


def _one_length() -> None:
    _change_processes(lambda process: replace(process, lengths=dict([next(iter(process.lengths.items()))])))


def _change_processes(change: Callable[[Process], Process | None]) -> None:
    def changed(*given: Any, **how: Any) -> Iterator[Process]:
        return filter(None, map(change, processes_of(*given, **how)))

    for module in (diagnosing, search_and_noise):
        _put(module, "processes_of", changed)


ARM = Path(__file__).resolve().parents[2] / "examples" / "machines" / "ur10"
PARTS = [
    ("series_c", 0, 1),
    ("series_a", 0, 1),
    *(("series_c", k, 2) for k in (0, 1)),
    *(("series_a", k, 3) for k in range(3)),
]
"""Series of the real arm with the first row and every how many-th row is taken."""
CHOICES: dict[str, Callable[[], None]] = {
    "amplitudes averaged over": lambda: _put(evidence, "LOG_SCALES", np.zeros(1)),
    "a scale of its own for what shapes": lambda: _put(evidence, "SHAPINGS", np.ones(1)),
    "forms share a prior": lambda: _put(
        problem.Problem,
        "log_priors",
        property(lambda self: dict.fromkeys((i.effect for i in self.explanations), 0.0)),
    ),
    "workmanship as a variance component": _no_workmanship,
    "coarse workmanship is workmanship": lambda: _put(
        priors, "WORKMANSHIP_LEVELS", tuple(level for level in priors.WORKMANSHIP_LEVELS if level < 1 / 20)
    ),
    "what corrects another's form is no cause": lambda: _put(decision, "_above", lambda causes, *_: list(causes)),
    "what a larger cause does if its size varies is no cause": lambda: _put(diagnosing, "varied", lambda *_: []),
    "scatter is judged under a larger noise": lambda: _put(
        decision, "_as_noise", lambda discrepancy, found, kind: (found, discrepancy)
    ),
    "bent effects are refused": lambda: _put(search, "credible", lambda *_: True),
    "effects that cancel are refused": lambda: _put(
        diagnosing, "Thresholds", partial(Thresholds, most_cancelled=np.inf)
    ),
    "causes are challenged": lambda: _put(
        discrepancy.Discrepancy, "challenge", lambda self, indices: discrepancy.Challenge(Process("", "", {}), -np.inf)
    ),
    "several length scales": _one_length,
    "chance as something unknown": partial(_without_processes, CHANCE),
    "waves in time": partial(_without_processes, CYCLES),
    "what is unknown is no noise": lambda: _put(search_and_noise.Searched, "beside_unknown", lambda self: self),
    "what data hardly show is an alternative": lambda: _put(Thresholds, "hidden", property(lambda self: 0.0)),
    "minor effects are not named": lambda: _put(diagnosing, "Thresholds", partial(Thresholds, minor_share=0.0)),
    "least share of structure": lambda: _put(diagnosing, "Thresholds", partial(Thresholds, structure_share=0.0)),
    "least size of structure": lambda: _put(diagnosing, "Thresholds", partial(Thresholds, structure_size=0.0)),
    "a likely grade of workmanship": lambda: _put(priors, "LEVEL_SPREAD", 1e6),
    "one constant has one value": lambda: _put(
        hypotheses.Hypothesis,
        "choices",
        property(lambda self: [e for e in self.problem.explanations if e.key not in self.keys | self.barred]),
    ),
    "soft joints": _no_softness,
    "the search goes on from what was found": lambda: _put(
        diagnoser, "search", lambda problem, thresholds, *_: search.search(problem, thresholds)
    ),
    "what blocks held out in turn refute is unknown": lambda: _put(
        cross_validation.CrossValidatedGap, "refuted", property(lambda self: "")
    ),
    "what is far behind at first is not tried": lambda: _put(search, "_BRANCH_BEHIND", np.inf),
}


def _without(choice: str) -> None:
    """Switch a choice off in this process."""
    if choice:
        CHOICES[choice]()


def trials_without(choice: str, work: Sequence[Job], workers: int) -> dict[str, Trial]:
    """Return the trials of all jobs with a choice switched off ("" for none), by name; RuntimeError where one crashes.

    What switches it off does not fit what it replaces any more then, which costs the choice nothing.
    """
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(workers, context, _without, (choice,)) as pool:
        trials = {f"{t.name} {t.excluded}": t for found in pool.map(run, work) for t in found}
    if crashed := [f"{name}: {t.refused}" for name, t in trials.items() if t.refused.startswith("crash")]:
        raise RuntimeError(f"without '{choice}' {crashed[0]}")
    return trials


def said_of(part: tuple[str, int, int]) -> str:
    """Return what is said of every so many-th row of a series of the real arm, from the first on."""
    series, first, every = part
    campaign = Campaign.read(ARM / f"{series}.csv", ARM / "robot.yaml")
    found = diagnosing.diagnose(campaign.subset(np.arange(first, len(campaign), every)), ARM / "robot.yaml")
    return " ".join([found.verdict, *sorted(f"{e.cause.effect} ({e.cause.size:.1f})" for e in found.effects)])


def print_arm(choices: Sequence[str], workers: int) -> None:
    """Print what is said of each part of the arm's series, and what changes with a choice switched off."""
    usual: list[str] = []
    for choice in ("", *choices):
        with ProcessPoolExecutor(workers, multiprocessing.get_context("spawn"), _without, (choice,)) as pool:
            found = list(pool.map(said_of, PARTS))
        usual = usual or found
        for (series, first, every), now, before in zip(PARTS, found, usual, strict=True):
            if not choice or now != before:
                sys.stdout.write(f"{choice or 'as it is'} | {series} {first}::{every} | {now}\n")
        sys.stdout.flush()


def main(arguments: Sequence[str] | None = None) -> int:
    """Print a line a choice."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter, parents=[campaigns()]
    )
    parser.add_argument("--without", action="append", choices=CHOICES, help="only this choice; may be repeated")
    parser.add_argument("--arm", action="store_true", help="of series of a real arm and parts of them: what is said")
    options = parser.parse_args(arguments)
    if options.arm:
        print_arm(options.without or list(CHOICES), options.workers)
        return 0
    work = jobs(options)
    usual = trials_without("", work, options.workers)
    right = _right(usual)
    sys.stdout.write(f"as it is: {len(right)} of {len(usual)} right\n\n")
    sys.stdout.write("| switched off | right | lost | won |\n|---|---|---|---|\n")
    for choice in options.without or CHOICES:
        found = _right(trials_without(choice, work, options.workers))
        lost, won = sorted(right - found), sorted(found - right)
        sys.stdout.write(f"| {choice} | {len(found)} | {_listed(lost, usual)} | {_listed(won, usual)} |\n")
        sys.stdout.flush()
    return 0


def _right(found: dict[str, Trial]) -> set[str]:
    wrong = {id(t) for t in failures(list(found.values()))}
    return {name for name, t in found.items() if id(t) not in wrong}


def _listed(names: Sequence[str], trials: dict[str, Trial]) -> str:
    kinds = [f"{trials[name].kind}{' excluded' if trials[name].excluded else ''}" for name in names]
    counts = {kind: kinds.count(kind) for kind in dict.fromkeys(kinds)}
    return ", ".join(f"{count} {kind}" for kind, count in counts.items()) or "none"


if __name__ == "__main__":
    raise SystemExit(main())
