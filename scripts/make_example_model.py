"""Draw the machining errors of examples/actual.yaml: a robot as a good workshop would build it."""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from pouring_robot.robot.model import JointPlacement, RobotModel

SEED = 20221
CENTRE_MM = 0.15  # standard deviation of a U-joint centre, each direction
AXIS_MRAD = 0.15  # standard deviation of an axis direction, about each axis
LENGTH_MM = 0.10  # standard deviation of a leg's zero length

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("--out", type=Path, default=Path("examples/actual.yaml"))
arguments = parser.parse_args()

random = np.random.default_rng(SEED)


def draw(translation: tuple[float, float, float], rotation: tuple[float, float, float]) -> JointPlacement:
    """Draw one placement error with the given standard deviations (mm, mrad), to a tenth of a micrometre."""
    t, r = (np.round(random.normal(size=3) * spread, 4) + 0.0 for spread in (translation, rotation))
    return JointPlacement(translation_mm=tuple(t.tolist()), rotation_mrad=tuple(r.tolist()))


placements: dict[str, JointPlacement] = {}
for leg in (1, 2, 3, 4):
    placements[f"leg{leg}_s1"] = draw((CENTRE_MM,) * 3, (AXIS_MRAD, 0.0, AXIS_MRAD))
    placements[f"leg{leg}_s2"] = draw((0.0, 0.0, 0.0), (0.0, AXIS_MRAD, AXIS_MRAD))
    placements[f"leg{leg}_s3"] = draw((0.0, 0.0, LENGTH_MM), (AXIS_MRAD, AXIS_MRAD, 0.0))
    placements[f"leg{leg}_s4"] = draw((0.0, 0.0, 0.0), (0.0, AXIS_MRAD, AXIS_MRAD))
    placements[f"leg{leg}_seat_mount"] = draw((CENTRE_MM,) * 3, (AXIS_MRAD, 0.0, AXIS_MRAD))
model = RobotModel(
    description=f"plausible machining errors: centres {CENTRE_MM} mm, axes {AXIS_MRAD} mrad, "
    f"lengths {LENGTH_MM} mm (standard deviations, seed {SEED})",
    joint_placements=placements,
)
print(f"wrote {model.save(arguments.out, overwrite=True)}")
