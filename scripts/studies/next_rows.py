"""The value of suggested measurements: groups that they resolve, compared with as many random ones.

    python -m scripts.studies.next_rows --seeds 8              # half an hour
    python -m scripts.studies.next_rows --seeds 1 --next 4     # two minutes

Machines of the independent rig have one effect and are measured in a way that hides which one it is: from one side, at
one temperature, at one tilt, from one end of the rails to the other. Where ``diagnose`` answers with a group, its next
measurements are made on the same machine, and separately as many drawn at random from the same candidates; all rows
together are diagnosed again. Prints a Markdown table: for how many groups only the truth remained, and for how many
the answer was false.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np

from pouring_robot.diagnosis.diagnose import Diagnosis, diagnose
from pouring_robot.diagnosis.suggest.next_measurements import Suggestion, suggest_measurements
from pouring_robot.inference.discrimination import ChosenMeasurements, Prediction
from pouring_robot.io.threads import one_blas_thread
from tests.diagnosis.remeasured import Machine
from tests.rig.campaign import CONFOUNDED
from tests.rig.effects import FORMS

_SUGGEST = import_module("pouring_robot.diagnosis.suggest.next_measurements")


@dataclass(frozen=True)
class Again:
    """What was said of a machine after more measurements.

    Attributes:
        resolved: whether its effect is named, alone and without alternatives.
        false: whether something else is named beside it, or in its place.
    """

    resolved: bool
    false: bool

    @classmethod
    def of(cls, found: Diagnosis, effect: str) -> Again:
        """Return it for a machine that has an effect."""
        causes = found.judgement.causes
        names = {name for cause in causes for name in (cause.effect, *cause.alternatives)}
        true = [effect in {cause.effect, *cause.alternatives} for cause in causes]
        return cls(found.verdict == "named" and names == {effect}, not all(true) and found.verdict != "unknown")


def at_random(found: Diagnosis, count: int, seed: int) -> Suggestion:
    """Return as many of the same candidates, drawn."""
    rng = np.random.default_rng([seed, 29])

    def drawn(
        predictions: Sequence[Prediction], pairs: Sequence[Any], components: int, most: int
    ) -> ChosenMeasurements:
        rows = len(predictions[0].mean) // components
        return ChosenMeasurements(rng.choice(rows, most, replace=False), np.ones((most, len(pairs))))

    with patch.object(_SUGGEST, "choose", drawn):
        return suggest_measurements(found, count, seed)


def machines(seeds: int) -> Iterator[tuple[str, str, Machine]]:
    """Yield trap, effect and machine."""
    for effect, only, trap in CONFOUNDED:
        for form in [only] if only else sorted(FORMS[effect]):
            for seed in range(seeds):
                yield trap, effect, Machine(effect, form, trap, seed=seed)


@one_blas_thread()
def main(arguments: Sequence[str] | None = None) -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=8)
    parser.add_argument("--next", type=int, nargs="+", default=[2, 5, 10], help="how many measurements are made")
    options = parser.parse_args(arguments)
    said: dict[tuple[str, int, str], list[Again]] = {}
    tried = groups = 0
    with tempfile.TemporaryDirectory() as folder:
        for number, (trap, effect, machine) in enumerate(machines(options.seeds)):
            place = Path(folder) / str(number)
            tried += 1
            before = diagnose(machine.measured(place / "before"))
            if before.verdict != "group":
                continue
            groups += 1
            for count in options.next:
                ways = {
                    "suggested": suggest_measurements(before, count, number),
                    "random": at_random(before, count, number),
                }
                for way, found in ways.items():
                    scene = machine.with_more(found.measurements)
                    after = diagnose(machine.measured(place / f"{way}_{count}", scene))
                    for key in (trap, "all"):
                        said.setdefault((key, count, way), []).append(Again.of(after, effect))
    sys.stdout.write(f"{groups} of {tried} machines gave a group\n\n")
    sys.stdout.write(
        "| measured so that | more rows | suggested: truth alone | false | at random: truth alone | false |\n"
    )
    sys.stdout.write("|---|---|---|---|---|---|\n")
    for trap, count in sorted(dict.fromkeys((trap, count) for trap, count, _ in said), key=lambda key: key[0] == "all"):
        cells = [f"{trap.replace('_', ' ')} | {count}"]
        for way in ("suggested", "random"):
            one = said[trap, count, way]
            cells.append(f"{sum(a.resolved for a in one)} of {len(one)} | {sum(a.false for a in one)}")
        sys.stdout.write(f"| {' | '.join(cells)} |\n")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
