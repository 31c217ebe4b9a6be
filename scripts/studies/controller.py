"""The C header of ``compensate --header``, compiled by gcc, against the package on thousands of random poses.

    python -m scripts.studies.controller            # cold, then with the melt at 1700 degC (two minutes)
    python -m scripts.studies.controller --poses 100 --seeds 2

``differs`` is the largest difference of the commands of legs and tilt drive from those of the package; ``stated`` is
the error that the header states.
"""

from __future__ import annotations

import argparse
import subprocess
import tempfile
from pathlib import Path

import numpy as np

from pouring_robot.compensation.path import compensate_path, make_controller
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.robot.heat_section import HeatSection
from pouring_robot.robot.pouring_robot import load_robot
from pouring_robot.thermal.expansion.warm_pouring_robot import HeatedRobot

ROOT = Path(__file__).resolve().parents[2]
MAIN = """#include <stdio.h>
#include "compensate.h"
int main(void)
{
    double w[4], d[4] = {0.0, 0.0, 0.0, 0.0};
    while (scanf("%lf %lf %lf %lf", w, w + 1, w + 2, w + 3) == 4) {
        int code = pouring_robot_compensate(w, d);
        printf("%d %.17g %.17g %.17g %.17g\\n", code, d[0], d[1], d[2], d[3]);
    }
    return 0;
}
"""
STRICT = ("-std=c99", "-pedantic", "-Wall", "-Wextra", "-Werror", "-O1")


def compiled(header: str, folder: Path) -> Path:
    """Return a program, made by gcc, that reads poses and prints code and drives."""
    (folder / "compensate.h").write_text(header, encoding="utf-8")
    (folder / "main.c").write_text(MAIN, encoding="utf-8")
    subprocess.run(["gcc", *STRICT, "main.c", "-lm", "-o", "main"], cwd=folder, check=True)
    return folder / "main"


def answers(program: Path, poses: FloatArray) -> FloatArray:
    """Return what the program says of poses (n, 4): its code and the drives, (n, 5)."""
    lines = "\n".join(" ".join(repr(float(value)) for value in row) for row in poses)
    ran = subprocess.run([program], input=lines, check=True, capture_output=True, text=True)
    return np.array([line.split() for line in ran.stdout.splitlines()], dtype=float)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--poses", type=int, default=1000)
    parser.add_argument("--seeds", type=int, default=12)
    given = parser.parse_args()
    robot = load_robot(ROOT / "examples" / "actual.yaml")
    lower, upper = robot.layout.box
    head = ("robot", "seed", "poses", "differs, mm", "differs, mrad", "stated, mm", "stated, mrad")
    print(f"| {' | '.join(head)} |\n|{'---|' * len(head)}")
    for name, heat in (("cold", None), ("melt at 1700 °C", HeatSection(melt_degC=1700.0))):
        heated = HeatedRobot(robot, heat)
        made = make_controller(heated)
        with tempfile.TemporaryDirectory() as folder:
            program = compiled(made.header(), Path(folder))
            for seed in range(given.seeds):
                poses = np.random.default_rng(seed).uniform(lower, upper, (given.poses, 4))
                found = answers(program, poses)
                off = np.abs(found[:, 1:] - compensate_path(heated, poses).drives).max(axis=0)
                figures = " | ".join(
                    f"{1e3 * each:.1e}" for d in (off, made.drive_error) for each in (d[:3].max(), d[3])
                )
                print(
                    f"| {name} | {seed} | {int((found[:, 0] == 0.0).sum())} of {given.poses} | {figures} |", flush=True
                )


if __name__ == "__main__":
    main()
