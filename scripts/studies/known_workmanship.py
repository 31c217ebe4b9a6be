"""Whether who knows how well a machine is made would name what a diagnosis misses.

    python -m tests.examiner --out DIR --cases 120 --seed 67
    python -m scripts.studies.known_workmanship DIR     # two minutes

A diagnosis has to find the size of workmanship together with its causes. Of every hidden effect that is in the library
and stands neither in the answer nor among its alternatives, this prints what it is worth beside what was found, and
beside workmanship of the size that the machine really has (the next finer level, in the effect's favour): what stays
below the evidence that is asked for, these data do not hold.
"""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from pouring_robot.diagnosis.diagnose import Diagnosis, diagnose
from pouring_robot.inference.hypotheses import WORKMANSHIP_LEVELS, Hypothesis
from pouring_robot.io.threads import one_blas_thread

SIZES = {"joint_centre_offset": "centres_sd_mm", "joint_axis_tilt": "axes_sd_mrad"}
"""Under which key the truth says how large workmanship of a kind is, in its usual units."""


@dataclass(frozen=True)
class Missed:
    """A hidden effect that the answer does not hold.

    Attributes:
        name: of the case.
        effect: its id, and the form it has.
        size: root mean square of what it makes, over the noise.
        found: what it is worth beside what was found, in nats.
        known: the same beside workmanship of the machine's own size.
        least: what it must be worth to be named.
    """

    name: str
    effect: str
    size: float
    found: float
    known: float
    least: float

    @property
    def row(self) -> str:
        """The line of a table."""
        nats = " | ".join(f"{worth:.1f}" for worth in (self.found, self.known, self.least))
        return (
            f"| {self.name} | {self.effect} {self.size:.1f} | {nats} | {'yes' if self.known > self.least else 'no'} |"
        )


def finer_level(size: float) -> int:
    """Return which level of workmanship is the next below a size."""
    return max((k for k, level in enumerate(WORKMANSHIP_LEVELS) if level <= size), default=0)


def worth(hypothesis: Hypothesis, effect: str) -> float:
    """Return what the best form of an effect is worth beside a hypothesis, in nats; -inf where none can be tested."""
    forms = hypothesis.contenders((effect,))
    return forms[0][0].evidence + hypothesis.problem.log_priors[effect] if forms else -math.inf


def missed(name: str, truth: dict[str, Any], diagnosis: Diagnosis) -> Iterator[Missed]:
    """Yield the hidden effects that a diagnosis of a case holds neither for a cause nor for an alternative of one."""
    hypothesis = diagnosis.hypothesis
    told = {effect for cause in diagnosis.judgement.causes for effect in (cause.effect, *cause.alternatives)}
    sizes = [truth["workmanship"][SIZES[kind.effect]] for kind in hypothesis.problem.workmanship]
    real = replace(hypothesis, levels=tuple(map(finer_level, sizes)))
    least = diagnosis.diagnoser.thresholds.least_evidence
    for one in truth["effects"]:
        effect = one["effect"]
        if effect in hypothesis.problem.known and effect not in told:
            said = f"{effect} ({one['form']})"
            yield Missed(name, said, one["ratio_to_noise"], worth(hypothesis, effect), worth(real, effect), least)


@one_blas_thread()
def main(arguments: Sequence[str] | None = None) -> int:
    """Print what was missed in a folder of cases; return 0."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("folders", nargs="+", type=Path)
    found, hidden = list[Missed](), 0
    for folder in parser.parse_args(arguments).folders:
        for case in sorted(folder.glob("case_*")):
            truth = json.loads((case / "truth.json").read_text(encoding="utf-8"))
            if truth["kind"] in {"single", "pair", "confounded"}:
                hidden += len(truth["effects"])
                found += missed(f"{folder.name}/{case.name}", truth, diagnose(case / "campaign.csv"))
    print("| case | hidden, times the noise | beside what was found | beside what is | asked for | would be named |")
    print("|---|---|---|---|---|---|")
    print(*(one.row for one in found), sep="\n")
    named = sum(one.known > one.least for one in found)
    print(f"\n{len(found)} of {hidden} hidden effects are missed; who knows workmanship would name {named} of them")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
