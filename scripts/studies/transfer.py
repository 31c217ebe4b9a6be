"""What a model that one campaign taught says of another campaign of the same robot: with all it holds, and with less.

    U=examples/machines/ur10
    pouring-robot diagnose $U/series_c.csv --robot $U/robot.yaml --out found
    python -m scripts.studies.transfer found/model.yaml $U/series_a.csv --learnt-from $U/series_c.csv

Only the two outer frames are fitted, to all rows but those of the block that ``diagnose`` holds out. Printed are the
RMS of a coordinate in held-out and other rows: of the drawing, of the model, of the model without each of its effects
that depend on conditions, of its places and axes alone, and with errors of a joint's own angle only where it was
learnt, within two degrees of an angle of the other campaign.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from pouring_robot.campaign.data import Campaign
from pouring_robot.diagnosis.rows import CampaignRows, RowChanges
from pouring_robot.effects.base import EffectParameter
from pouring_robot.estimation.noise import stated_noise
from pouring_robot.estimation.splits import split
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.robot.model import RobotModel

NEAR_RAD = np.radians(2.0)
PERIODIC = "joint_periodic"


class WhereLearnt(CampaignRows):
    """Rows in which errors of a joint's own angle count only near angles that were seen before."""

    seen: FloatArray

    def changes(self, parameters: Sequence[EffectParameter], values: FloatArray) -> RowChanges:
        """Return the changes, with none of a drive where its angle is far from all seen."""
        found = super().changes(parameters, values)
        apart = np.array(
            [[np.abs(s - v).min() for s, v in zip(self.seen.T, row, strict=True)] for row in self.campaign.drives]
        )
        return RowChanges(np.where(apart < NEAR_RAD, found.drives, 0.0), found.placements, found.base, found.scale)


def figures(model: RobotModel, campaign: Campaign, learnt: FloatArray | None = None) -> tuple[float, float]:
    """Return the RMS of a coordinate in held-out and in other rows, in mm.

    Args:
        model: as it is.
        campaign: of the same robot.
        learnt: drive values seen, (n, drives): errors of drives count only near them.
    """
    fitted = np.ones(len(campaign), dtype=bool)
    fitted[split(campaign, np.zeros(0, dtype=np.intp)).test] = False
    kind = CampaignRows if learnt is None else type("Seen", (WhereLearnt,), {"seen": learnt})
    rows = kind(campaign, model, stated_noise(campaign, np.flatnonzero(fitted)))
    linear = rows.linearise(rows.unchanged(), rows.refined_frames(fitted))
    parts = (linear.of(part) for part in (~fitted, fitted))
    return tuple(1e3 * float(np.sqrt(np.mean((p.residual * p.tracker)[p.component < 3] ** 2))) for p in parts)  # type: ignore[return-value]


def cases(model: RobotModel, campaign: Campaign, other: Path | None) -> Iterator[tuple[str, tuple[float, float]]]:
    """Yield what is put in, and its figures."""
    yield (
        "drawing",
        figures(model.model_copy(update={"joint_placements": {}, "drive_offsets": {}, "effects": []}), campaign),
    )
    yield "model", figures(model, campaign)
    moving = tuple(dict.fromkeys(entry.effect for entry in model.effects if not entry.placed))
    for effect in moving:
        kept = [entry for entry in model.effects if entry.effect != effect]
        yield f"without {effect}", figures(model.model_copy(update={"effects": kept}), campaign)
    placed = [entry for entry in model.effects if entry.placed]
    yield "places and axes alone", figures(model.model_copy(update={"effects": placed}), campaign)
    if other and PERIODIC in moving:
        kept = [entry for entry in model.effects if entry.placed or entry.effect == PERIODIC]
        seen = Campaign.of(other, model.definition).drives
        own = model.model_copy(update={"effects": kept})
        yield f"and {PERIODIC}", figures(own, campaign)
        yield f"and {PERIODIC} where it was learnt", figures(own, campaign, seen)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("model", type=Path)
    parser.add_argument("campaign", type=Path)
    parser.add_argument("--learnt-from", type=Path, help="the campaign that taught the model")
    options = parser.parse_args()
    model = RobotModel.load(options.model)
    campaign = Campaign.of(options.campaign, model.definition)
    print("| put in | held out, mm | other rows, mm |\n|---|---|---|")
    for name, (held_out, others) in cases(model, campaign, options.learnt_from):
        print(f"| {name} | {held_out:.3f} | {others:.3f} |", flush=True)


if __name__ == "__main__":
    main()
