"""The value of a planned campaign: the ladle's expected standard deviation with planned and with random poses.

    python scripts/studies/planning.py                      # a few minutes
    python scripts/studies/planning.py --random 10 --quick  # half a minute

For several parameter sets and criteria, plans of 30 poses are compared with random plans of 30 poses (median of 50),
for the same parameters and noise (0.05 mm, 0.05 mrad). Prints a Markdown table; exit code 1 if a D-optimal plan leaves
more than 70 % of the random plans' standard deviation.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from dataclasses import replace

from pouring_robot.design.planning import Comparison, Planner, compare_with_random
from pouring_robot.design.request import PlanRequest
from pouring_robot.estimation.noise import NoiseLevel
from pouring_robot.io.units import MM
from pouring_robot.robot.pouring_robot import PouringRobot
from pouring_robot.robot.tolerances import Tolerances

REQUIRED = 0.70
_HEADINGS = (
    "parameters",
    "number",
    "criterion",
    "lip, mm RMS",
    "random, mm RMS",
    "ratio mm",
    "ratio mrad",
    "ratio at the worst pose",
    "search, s",
)


def requests(poses: int, *, quick: bool) -> list[tuple[str, PlanRequest]]:
    """Return what is studied, with a name each."""
    plain = PlanRequest(poses=poses, reduce=True)
    studied = [
        ("centres", plain),
        ("geometry", replace(plain, parameters=("geometry",))),
        ("DH table", replace(plain, parameters=("dh",))),
        ("geometry, tolerances as priors", replace(plain, parameters=("geometry",), priors=Tolerances.load())),
        ("centres, positions only", replace(plain, noise=NoiseLevel.stated(5e-5, None))),
    ]
    if quick:
        return studied[:2]
    conditions = replace(plain, both_sides=poses // 4, loads_kg=(0.0, 500.0), drive_degC=(20.0, 120.0))
    studied.append(("centres, backlash, compliance, expansion", conditions))
    for criterion in ("O2", "O3", "O4", "O5"):
        studied.append(("centres", replace(plain, criterion=criterion)))
    return studied


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the study and return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--poses", type=int, default=30)
    parser.add_argument("--random", type=int, default=50, help="random plans to compare with")
    parser.add_argument("--quick", action="store_true", help="D-optimal plans of two parameter sets only")
    given = parser.parse_args(arguments)
    robot = PouringRobot()
    print(f"| {' | '.join(_HEADINGS)} |\n|{'---|' * len(_HEADINGS)}")
    worst = 0.0
    for name, request in requests(given.poses, quick=given.quick):
        planner = Planner(robot, request)
        began = time.perf_counter()
        plan = planner.plan()
        took = time.perf_counter() - began
        comparison = compare_with_random(planner, plan, given.random)
        print(_row(name, request, len(plan.parameters), comparison, took), flush=True)
        if request.criterion == "D":
            worst = max(worst, float(comparison.ratios[0]))
    print(
        f"\nD-optimal plans leave at most {worst:.0%} of the random plans' standard deviation ({REQUIRED:.0%} allowed)"
    )
    return 0 if worst <= REQUIRED else 1


def _row(name: str, request: PlanRequest, parameters: int, found: Comparison, took: float) -> str:
    cells = (
        name,
        str(parameters),
        request.criterion,
        f"{found.planned[0] / MM:.4f}",
        f"{found.median[0] / MM:.4f}",
        *(f"{ratio:.2f}" for ratio in found.ratios),
        f"{took:.1f}",
    )
    return f"| {' | '.join(cells)} |"


if __name__ == "__main__":
    sys.exit(main())
