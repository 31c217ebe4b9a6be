"""Which machining errors matter? Load a robot, state how accurately it is made, and look at the worst ten.

Copy this file and change the errors to those of your workshop. Run it again after an interruption: it continues.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from pouring_robot.sweeps import ErrorEntry, Grid, Poses, SweepConfig, sweep

ERRORS = (
    ErrorEntry(parameters=("alpha_e*_*", "theta_e*_*"), half_width_mrad=0.3),  # directions of joint axes
    ErrorEntry(parameters=("a_e*_*", "d_e*_*"), half_width_mm=0.1),  # lengths and offsets
    ErrorEntry(parameters=("drive.leg4_s5",), half_width_mrad=0.1),  # zero of the tilt drive
)


def main() -> None:
    """Set every error alone to its tolerance, at poses all over the workspace."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("error_sweep"), help="folder for the results")
    parser.add_argument("--workers", type=int, default=0, help="processes to share the work (default: this one)")
    arguments = parser.parse_args()

    config = SweepConfig(
        layout="paper",
        study="one_at_a_time",
        poses=Poses(grid=Grid(x=3, y=3, z=5, tilt=5)),
        errors=ERRORS,
    )
    outcome = sweep(config, arguments.out, resume=True, workers=arguments.workers)
    print(f"the worst ten of {len(outcome.ranking)} errors, each alone at its tolerance, at the ladle's lip:")
    for parameter in outcome.ranking[:10]:
        figures = parameter.figures
        print(
            f"  {parameter.name:12} {parameter.tolerance:4.2f} {parameter.unit:4}  at most "
            f"{figures['largest_mm']:6.3f} mm, mostly along {figures['main_axis']}   ({parameter.part})"
        )

    # The numbers themselves are labelled arrays in SI units.
    displacement = outcome.to_dataset().displacement.sel(frame="ladle_lip")
    worst = np.abs(displacement).max(dim=("parameter", "pose")).compute()
    print("largest along x, y, z:", np.round(1e3 * worst.values, 3), "mm")
    for path in outcome.save():
        print(f"wrote {path}")


if __name__ == "__main__":
    main()
