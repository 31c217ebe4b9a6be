"""Blind trials of the diagnosis on the example robots: one line a campaign, and how often it was right.

    python scripts/studies/any_robot_trials.py --trials 5                          # every effect of every robot
    python scripts/studies/any_robot_trials.py --robots arm --effects periodic,null --json trials.json

Campaigns come from ``tests.examples``, which shares no code with the library; ``pouring-robot diagnose --robot`` gets
table, YAML and robot file. The truth is read after it. A named effect is right where it, or one that the data cannot
tell apart from it, is what was hidden; each other one is false. Exit code 1 if a diagnosis crashed.
"""

from __future__ import annotations

import argparse
import json
import math
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
if str(ROOT) not in sys.path:  # the campaigns are no part of the package: they are found from the repository
    sys.path.insert(0, str(ROOT))

from rich.console import Console  # noqa: E402
from rich.progress import track  # noqa: E402

from tests.examples.campaigns import NULL, write  # noqa: E402
from tests.examples.effects import EFFECTS, effects_of  # noqa: E402
from tests.examples.machines import MACHINES  # noqa: E402

IDS = {
    "zero_offset": {"drive_zero_offset"},
    "scale": {"drive_scale"},
    "periodic": {"drive_periodic", "joint_periodic"},
    "lost_motion": {"drive_backlash"},
    "placement": {"joint_placement"},
    "base_drift": {"base_drift"},
    "metrology_scale": {"metrology_scale"},
    "thermal": {"link_thermal_expansion"},
    "compliance": {"drive_compliance"},
    "soft_joints": {"joint_compliance"},
    "session_offset": {"session_offset"},
}
"""What the library calls the effects, without the group of drives."""

WEAK = 1.5
"""Times the noise below which an effect may be overlooked."""


@dataclass(frozen=True)
class Trial:
    """One campaign and what was said of it.

    Attributes:
        robot: its name.
        effect: what was hidden.
        seed: of the campaign.
        ratio: how many times the noise it shows.
        verdict: of the diagnosis; "exit 2" and the like where there is none.
        named: effects with their alternatives.
        right: whether the hidden one is among them; of a null campaign, whether none was found.
        false: how many of the named are something else.
        gap_mm: held out before, after and floor, RMS of a coordinate.
        gap_mrad: the same of rotations.
        seconds: taken.
        said: the last line of a refusal.
    """

    robot: str
    effect: str
    seed: int
    ratio: float
    verdict: str
    named: tuple[str, ...]
    right: bool
    false: int
    gap_mm: tuple[float, ...]
    gap_mrad: tuple[float, ...]
    seconds: float
    said: str = ""

    def cells(self) -> tuple[str, ...]:
        """Return it as cells of the table."""
        outcome = "right" if self.right else "weak" if self.effect != NULL and self.ratio < WEAK else "WRONG"
        gaps = (" ".join(f"{v:.3g}" for v in gap) for gap in (self.gap_mm, self.gap_mrad))
        named = self.said or ", ".join(self.named)
        return (
            self.robot,
            self.effect,
            str(self.seed),
            f"{self.ratio:.1f}",
            self.verdict,
            outcome,
            str(self.false),
            *gaps,
            f"{self.seconds:.0f}",
            named,
        )


HEADINGS = (
    *("robot", "effect", "seed", "over noise", "verdict", "named", "false"),
    *("held-out mm: before after floor", "mrad", "s", "said"),
)


def run(robot: str, effect: str, seed: int, folder: Path) -> Trial:
    """Write a campaign, diagnose it as a user does, and read the answer."""
    truth = write(folder, MACHINES[robot], seed, effect)
    ratio = truth["effects"][0]["ratio_to_noise"] if truth["effects"] else math.nan
    command = ["diagnose", str(folder / "campaign.csv"), "--out", str(folder / "found")]
    command += ["--robot", str(ROOT / "examples" / "robots" / robot / "robot.yaml")]
    begun = time.perf_counter()
    done = subprocess.run(
        [sys.executable, "-m", "pouring_robot", *command], cwd=ROOT, capture_output=True, text=True, check=False
    )
    seconds = time.perf_counter() - begun
    if done.returncode:
        said = (done.stderr.strip() or done.stdout.strip()).splitlines()[-1]
        return Trial(robot, effect, seed, ratio, f"exit {done.returncode}", (), False, 0, (), (), seconds, said)
    found = json.loads((folder / "found" / "diagnosis.json").read_text(encoding="utf-8"))
    named = [(e["effect"], *e["alternatives"]) for e in found["effects"]]
    hits = [any(_is(name, effect) for name in group) for group in named]
    right = found["verdict"] == "no_gap" if effect == NULL else any(hits) and found["verdict"] in {"named", "group"}
    return Trial(
        robot,
        effect,
        seed,
        ratio,
        found["verdict"],
        tuple(" or ".join(group) for group in named),
        right,
        len(hits) - sum(hits),
        _gap(found["gap"]["held_out"], "mm"),
        _gap(found["gap"]["held_out"], "mrad"),
        seconds,
    )


def _is(name: str, effect: str) -> bool:
    return name.partition(".")[0] in IDS.get(effect, ())


def _gap(gap: dict[str, Any], unit: str) -> tuple[float, ...]:
    return tuple(float(gap.get(f"{what}_rms_{unit}") or math.nan) for what in ("before", "after", "floor"))


def summary(trials: Sequence[Trial]) -> Iterator[str]:
    """Yield a Markdown table: of each effect and robot how many were right, and what did not show or was false."""
    robots = tuple(dict.fromkeys(t.robot for t in trials))
    yield f"| hidden | {' | '.join(robots)} |\n{'|---' * (len(robots) + 1)}|"
    for effect in dict.fromkeys(t.effect for t in trials):
        cells = [_cell([t for t in trials if (t.robot, t.effect) == (robot, effect)]) for robot in robots]
        yield f"| `{effect}` | {' | '.join(cells)} |"


def _cell(trials: Sequence[Trial]) -> str:
    weak, false = sum(t.ratio < WEAK for t in trials), sum(t.false for t in trials)
    words = [f"{weak} under {WEAK:g} times the noise"] * bool(weak) + [f"{false} false beside"] * bool(false)
    right = f"{sum(t.right for t in trials)} of {len(trials)}" if trials else "–"
    return f"{right} ({', '.join(words)})" if words else right


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the trials, print the table and return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--robots", default=",".join(MACHINES), help="by commas (all)")
    parser.add_argument("--effects", default=",".join([NULL, *EFFECTS]), help="by commas (all)")
    parser.add_argument("--trials", type=int, default=5, help="campaigns of each effect and robot (5)")
    parser.add_argument("--seed", type=int, default=1, help="of the first of them (1)")
    parser.add_argument("--json", type=Path, help="write the records here")
    parser.add_argument("--from", type=Path, nargs="+", dest="read", help="records of earlier runs: only sum them up")
    options = parser.parse_args(arguments)
    if options.read:
        records = [record for path in options.read for record in json.loads(path.read_text(encoding="utf-8"))]
        print(*summary([Trial(**record) for record in records]), sep="\n")
        return 0
    effects = options.effects.split(",")
    work = [
        (robot, effect, seed)
        for robot in options.robots.split(",")
        for effect in (NULL, *effects_of(MACHINES[robot]))
        if effect in effects
        for seed in range(options.seed, options.seed + options.trials)
    ]
    found = []
    print("| " + " | ".join(HEADINGS) + " |\n" + "|---" * len(HEADINGS) + "|", flush=True)
    with tempfile.TemporaryDirectory() as folder:
        for number, job in enumerate(track(work, console=Console(stderr=True), transient=True)):
            found.append(run(*job, Path(folder) / str(number)))
            print("| " + " | ".join(found[-1].cells()) + " |", flush=True)
    print("", *summary(found), sep="\n")
    if options.json:
        options.json.write_text(json.dumps([asdict(t) for t in found], indent=1) + "\n", encoding="utf-8")
    return int(any(t.verdict.startswith("exit") and t.verdict not in {"exit 2", "exit 3"} for t in found))


if __name__ == "__main__":
    sys.exit(main())
