"""A campaign as a user holds it: one import, one line at the prompt, a small table in a notebook."""

import copy
import pickle

import numpy as np
import pytest

from pouring_robot import Campaign, PlatformPose


def test_a_campaign_is_read_shown_and_saved(real, tmp_path):
    table, beside = real.campaign.save(tmp_path / "c.csv")
    campaign = Campaign.read(table)
    assert beside.is_file()
    assert repr(campaign) == f"<Campaign: {len(campaign)} full poses in 1 session, c.csv>"
    assert campaign.headline in campaign._repr_html_()
    assert len(campaign.to_frame()) == len(campaign)


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda one: pickle.loads(pickle.dumps(one))], ids=["copy", "pickle"])
def test_robots_and_campaigns_go_to_other_processes(real, as_built, copied):
    campaign, robot, pose = copied(real.campaign), copied(as_built), PlatformPose.from_mm_deg(-100, 20, -600, 17)
    assert campaign.to_frame().equals(real.campaign.to_frame())
    with pytest.raises(TypeError):
        campaign.conditions["payload"] = 0.0
    assert robot.model == as_built.model and robot.layout.accuracy_m == as_built.layout.accuracy_m
    np.testing.assert_array_equal(robot.transfer(pose), as_built.transfer(pose))
