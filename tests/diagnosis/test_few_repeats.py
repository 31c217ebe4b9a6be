"""Noise that few repeats tell, smaller than it is by chance: of a machine that is as drawn."""

import numpy as np
import pytest

from pouring_robot import diagnose
from pouring_robot.diagnosis import DiagnosisOptions
from tests.campaign.simulated import SIGMA_M, damaged, measure


@pytest.mark.parametrize(("gap_m", "verdict"), [(0.0, "no_gap"), (2e-4, "unknown")])
def test_what_few_repeats_say_too_small_by_chance_is_no_gap(drawing, gap_m, verdict):
    """Five readings of one pose, 0.6 times as far apart as the noise: what comes out in one of thirty campaigns."""
    campaign = measure(drawing, seed=4, sigma_rotation_rad=None).campaign
    campaign = campaign.subset(np.array([0] * 4 + [*range(60)]))
    moved = 0.6 * SIGMA_M * np.array([-2.0, -1.0, 0.0, 1.0, 2.0]) / np.sqrt(2.5)
    moved = np.concatenate([moved, gap_m * np.random.default_rng(1).choice([-1.0, 1.0], 59)])
    few = damaged(
        campaign,
        metadata=campaign.metadata.model_copy(update={"sigma_position_m": None}),
        position_m=lambda p: p + moved[:, None],
    )
    found = diagnose(few, None, DiagnosisOptions(next_count=0, hold_out="region"))
    assert (found.verdict, found.effects) == (verdict, ())
    if verdict == "no_gap":
        assert found.noise.position_m == pytest.approx(SIGMA_M, rel=0.1)
        assert found.noise.freedoms > 100.0
    else:
        assert found.noise.freedoms == 12.0
        assert "in place of what repeats tell, 0.03 mm" in found.headline
