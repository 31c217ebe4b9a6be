"""How well a model learned from one campaign predicts another campaign of the same robot: the whole model, and parts.

    U=examples/machines/ur10
    pouring-robot diagnose $U/series_c.csv --robot $U/robot.yaml --out taught_by_c
    pouring-robot diagnose $U/series_a.csv --robot $U/robot.yaml --out taught_by_a
    python -m scripts.studies.transfer taught_by_c/model.yaml $U/series_a.csv --own taught_by_a/model.yaml

Only the two outer frames are fitted, to all rows except the block that ``diagnose`` holds out. Printed are the RMS of a
coordinate in held-out and other rows: of the drawing, of the model, of the model without each of its effects that
depend on conditions, of its joint positions and axes alone, and of the model learned from the campaign itself; and the
share that each has of the latter's improvement over the drawing.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from pouring_robot.campaign.data import Campaign
from pouring_robot.diagnosis.rows import CampaignRows
from pouring_robot.estimation.noise import noise_beforehand
from pouring_robot.estimation.splits import split
from pouring_robot.robot.model import RobotModel

Figures = tuple[float, float]


def figures(model: RobotModel, campaign: Campaign) -> Figures:
    """Return the RMS of a coordinate in held-out and in other rows, in mm."""
    fitted = np.ones(len(campaign), dtype=bool)
    fitted[split(campaign, np.zeros(0, dtype=np.intp)).test] = False
    rows = CampaignRows(campaign, model, noise_beforehand(campaign, np.flatnonzero(fitted)))
    linear = rows.linearise(rows.unchanged(), rows.refined_frames(fitted))
    left = [
        part.residual[part.component < 3] * part.sigma[part.component < 3] for part in map(linear.of, (~fitted, fitted))
    ]
    held_out, others = (1e3 * float(np.sqrt(np.mean(values**2))) for values in left)
    return held_out, others


def cases(model: RobotModel, campaign: Campaign) -> Iterator[tuple[str, Figures]]:
    """Yield what is put in, and its figures."""
    bare: dict[str, object] = {"joint_placements": {}, "drive_offsets": {}, "effects": []}
    yield "drawing", figures(model.model_copy(update=bare), campaign)
    yield "model", figures(model, campaign)
    for effect in dict.fromkeys(entry.effect for entry in model.effects if not entry.placed):
        kept = [entry for entry in model.effects if entry.effect != effect]
        yield f"without {effect}", figures(model.model_copy(update={"effects": kept}), campaign)
    placed = [entry for entry in model.effects if entry.placed]
    yield "places and axes alone", figures(model.model_copy(update={"effects": placed}), campaign)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("model", type=Path)
    parser.add_argument("campaign", type=Path)
    parser.add_argument("--own", type=Path, required=True, help="the model that the campaign itself taught")
    options = parser.parse_args()
    model, own = RobotModel.load(options.model), RobotModel.load(options.own)
    campaign = Campaign.of(options.campaign, model.definition)
    found = [*cases(model, campaign), ("its own model", figures(own, campaign))]
    (_, most), (_, least) = found[0], found[-1]
    print("| put in | held out, mm | share of the gain | other rows, mm | share |\n|---|---|---|---|---|")
    for name, values in found:
        cells = [f"{v:.3f} | {100 * (a - v) / (a - b):.0f} %" for v, a, b in zip(values, most, least, strict=True)]
        print(f"| {name} | {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
