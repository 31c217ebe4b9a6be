"""Blind trials of the diagnosis: every figure with its interval, the confusion matrix, and every failure.

    python -m scripts.benchmarks.blind_trials --cases 60 --seed 1 --json trials.json  # the repository's rig
    python -m scripts.benchmarks.blind_trials --cases 200 --kinds outside,confounded  # only some kinds of the same set
    python -m scripts.benchmarks.blind_trials --cases 300 --effects base_drift        # only cases with some effect
    python -m scripts.benchmarks.blind_trials --folder ../campaigns                   # with truth.json, of any robots
    python -m scripts.benchmarks.blind_trials --folder D --told                       # … told how joints are made
    python -m scripts.benchmarks.blind_trials --records a.json b.json --plot p.png    # figures again, no diagnosis

Case k of seed S is case k of ``python -m tests.rig --seed S``. A single effect of 3 times the noise or more is
diagnosed a second time with that effect removed from the library. Each worker computes on its share of the cores; with
``--workers 1`` the seconds are those on all cores. Records contain the seeds. Exit code 1 if a figure misses its
requirement, or a diagnosis crashed.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import sys
import time
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
if str(ROOT) not in sys.path:  # the rig is no part of the package: it is found from the repository
    sys.path.insert(0, str(ROOT))

from rich.progress import Progress  # noqa: E402

from scripts.benchmarks.blind_metrics import (  # noqa: E402
    HEADINGS,
    confusion,
    coverage,
    failures,
    figures,
    power,
    reliability,
)
from scripts.benchmarks.blind_plots import draw  # noqa: E402
from tests.diagnosis.trial import Trial, rig_trials, trials_of  # noqa: E402
from tests.rig import make_campaign  # noqa: E402
from tests.rig.__main__ import CYCLE, KIND, case  # noqa: E402

_THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")


@dataclass(frozen=True)
class Job:
    """A campaign to be diagnosed.

    Attributes:
        name: of the campaign.
        folder: where it stands; None for one of the rig.
        number: of the rig's case.
        seed: of the rig's set.
        far: whether the rig's tracker stands far away.
        wide: whether rows, noise and workmanship vary as from shop to shop.
        exclude: whether a strong single is diagnosed without its effect, too.
        told: whether the diagnosis is told how well the joints are made, as the truth says.
        effects: only campaigns with one of these effects; all if empty.
    """

    name: str
    folder: Path | None = None
    number: int = 0
    seed: int = 0
    far: bool = False
    wide: bool = False
    exclude: bool = True
    told: bool = False
    effects: frozenset[str] = frozenset()


def run(job: Job) -> list[Trial]:
    """Diagnose one campaign."""
    if job.folder is not None:
        truth = json.loads((job.folder / "truth.json").read_text(encoding="utf-8"))
        if not _wanted(job, truth["effects"]):
            return []
        return trials_of(job.folder, job.name, exclude=job.exclude, told=job.told)
    campaign = case(job.number, job.seed, job.far, job.wide)
    return rig_trials(campaign, job.name, exclude=job.exclude) if _wanted(job, campaign.truth["effects"]) else []


def warm_up() -> None:
    """Diagnose a small campaign, so that nothing is compiled while time is taken."""
    rig_trials(make_campaign("null", 0, rows=40), "warm-up")


def _wanted(job: Job, hidden: Iterable[dict[str, object]]) -> bool:
    return not job.effects or any(e["effect"] in job.effects for e in hidden)


def campaigns() -> argparse.ArgumentParser:
    """Return the part of a command line that says which campaigns are diagnosed, and how; see :func:`jobs`."""
    parser = argparse.ArgumentParser(add_help=False)
    parser.add_argument("--cases", type=int, default=60, help="cases of the rig (60)")
    parser.add_argument("--first", type=int, default=0, help="number of the first case (0)")
    parser.add_argument("--seed", type=int, default=0, help="seed of the rig's set (0)")
    parser.add_argument("--far-tracker", action="store_true", help="the tracker stands metres away and turned")
    parser.add_argument("--wide", action="store_true", help="rows, noise and workmanship vary as from shop to shop")
    parser.add_argument("--folder", type=Path, help="folder of campaigns with truth.json, instead of the rig")
    parser.add_argument("--kinds", default="", help="only these, by commas: null,single,pair,outside,confounded")
    parser.add_argument("--effects", default="", help="only campaigns with one of these effects, by commas")
    parser.add_argument("--no-exclude", action="store_true", help="no second run without the true effect")
    parser.add_argument("--told", action="store_true", help="of a folder: say how well joints are made, as its truth")
    parser.add_argument("--workers", type=int, default=2, help="processes (2)")
    return parser


def jobs(options: argparse.Namespace) -> list[Job]:
    """Return what the command line asks for; what :func:`campaigns` reads."""
    kinds = frozenset(filter(None, options.kinds.split(",")))
    effects = frozenset(filter(None, options.effects.split(",")))
    if options.folder is None:
        return [
            Job(
                f"s{options.seed}/{k}",
                number=k,
                seed=options.seed,
                far=options.far_tracker,
                wide=options.wide,
                exclude=not options.no_exclude,
                effects=effects,
            )
            for k in range(options.first, options.first + options.cases)
            if not kinds or KIND[CYCLE[k % len(CYCLE)]] in kinds
        ]
    found = sorted(path.parent for path in options.folder.glob("*/truth.json"))
    return [
        Job(folder.name, folder, exclude=not options.no_exclude, told=options.told, effects=effects)
        for folder in found
        if not kinds or json.loads((folder / "truth.json").read_text(encoding="utf-8"))["kind"] in kinds
    ]


def trials(work: Sequence[Job], workers: int) -> Iterator[Trial]:
    """Yield the trials of all jobs, each worker on its share of the cores."""
    share = max(1, (os.cpu_count() or 1) // workers)
    os.environ.update(dict.fromkeys(_THREADS, str(share)))  # read where the worker, a new process, imports NumPy
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(workers, context, warm_up) as pool, Progress(transient=True) as progress:
        for found in progress.track(pool.map(run, work), total=len(work), description="diagnosing"):
            yield from found


def report(found: Sequence[Trial]) -> Iterator[str]:
    """Yield the lines of the report, in Markdown."""
    yield from _table(HEADINGS, [figure.cells() for figure in figures(found)])
    columns, matrix = confusion(found)
    yield from ("", "What was said (columns) of what was at work (rows), singles, pairs and the rest:", "")
    short = [str(k + 1) if k < len(columns) - 3 else name for k, name in enumerate(columns)]
    numbered = {name: f"{k + 1} {name}" for k, name in enumerate(columns[:-3])}
    rows = [(numbered.get(t, t), *(str(said[c]) if said[c] else "." for c in columns)) for t, said in matrix.items()]
    yield from _table(("", *short), rows)
    yield from ("", "Parameters with a known truth, where the effects were named right:", "")
    yield from _table(("effect", "parameter", "covered", "RMS error in std"), coverage(found))
    for words, some in (
        ("", [t for t in found if not t.excluded]),
        (", the truth taken out", [t for t in found if t.excluded]),
    ):
        yield from ("", f"Names stated with a probability, and how often they stand{words}:", "")
        shares = [s.cells() for s in reliability(some)]
        yield from _table(("stated", "stand", "mean stated", "share", "95 % interval"), shares)
    yield from ("", "Single effects named, alone or in their group, by size over the noise:", "")
    yield from _table(("size", "named", "mean size", "share", "95 % interval"), [s.cells() for s in power(found)])
    wrong = failures(found)
    yield from ("", f"{len(wrong)} of {len(found)} trials do not say what they should:", "")
    yield from (f"- {t.line()}" for t in wrong)


def _table(headings: Sequence[str], rows: Iterable[Sequence[str]]) -> Iterator[str]:
    table = [tuple(headings), *rows]
    widths = [max(len(row[k]) for row in table) for k in range(len(headings))]
    for k, row in enumerate(table):
        yield "| " + " | ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)) + " |"
        if k == 0:
            yield "|" + "|".join("-" * (width + 2) for width in widths) + "|"


def _recorded(path: Path) -> list[Trial]:
    return [Trial.from_dict(t) for t in json.loads(path.read_text(encoding="utf-8"))["trials"]]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the trials, print the report and return the exit code."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter, parents=[campaigns()]
    )
    parser.add_argument("--json", type=Path, help="write the records here")
    parser.add_argument("--records", type=Path, nargs="+", help="read records instead of diagnosing")
    parser.add_argument("--plot", type=Path, help="draw reliability and power as this PNG, a series for each records")
    options = parser.parse_args(arguments)
    if options.told and options.folder is None:
        parser.error("--told is of the campaigns in a --folder: the rig's truth does not say how joints are made")
    if options.records:
        sets = [(path.stem, _recorded(path)) for path in options.records]
        seconds = 0.0
    else:
        started = time.perf_counter()
        sets = [("blind trials", list(trials(jobs(options), max(1, options.workers))))]
        seconds = time.perf_counter() - started
    found = [t for _, each in sets for t in each]
    if options.json:
        record = {"seed": options.seed, "seconds": seconds, "trials": [t.as_dict() for t in found]}
        options.json.write_text(json.dumps(record, indent=1) + "\n", encoding="utf-8")
    if options.plot:
        draw(sets, options.plot)
    sys.stdout.write("\n".join(report(found)) + "\n")
    sys.stdout.write(f"\n{len(found)} diagnoses in {seconds:.0f} s with {options.workers} workers\n")
    return int(any(f.short for f in figures(found)) or any(t.refused.startswith("crash") for t in found))


if __name__ == "__main__":
    raise SystemExit(main())
