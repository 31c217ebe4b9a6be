"""A campaign as a result for the user: one import, one line at the prompt, a small table in a notebook."""

import copy
import dataclasses
import pickle
import re

import numpy as np
import pytest

from pouring_robot import BadInputError, Campaign, PlatformPose
from pouring_robot.exceptions import CampaignError, DescriptionError


def test_a_campaign_is_read_shown_and_saved(real, tmp_path):
    table, beside = real.campaign.save(tmp_path / "c.csv")
    campaign = Campaign.read(table)
    assert beside.is_file()
    assert repr(campaign) == f"<Campaign: {len(campaign)} full poses in 1 session, c.csv>"
    assert campaign.headline in campaign._repr_html_()
    more = [re.findall("<p>([^<]* more rows?)<", campaign.subset(np.arange(k))._repr_html_()) for k in (12, 13, 14)]
    assert more == [[], ["1 more row"], ["2 more rows"]]
    assert len(campaign.to_frame()) == len(campaign)
    position = np.array(campaign.position_m)
    position[3, 0] = position[5] = np.nan
    lost = dataclasses.replace(campaign, position_m=position)
    assert lost.headline.startswith(f"{len(campaign)} full poses ({len(campaign) - 2} whole) in 1 session")
    lost = dataclasses.replace(lost, rotation_vector_rad=None)
    assert lost.headline.startswith(f"{len(campaign)} positions ({len(campaign) - 2} whole) in 1 session")


def test_a_campaign_is_made_from_a_data_frame(real):
    frame = real.campaign.to_frame()
    made = Campaign.from_frame(frame, {"metrology": {"sigma_position_mm": 0.05}})
    np.testing.assert_array_equal(made.drives, real.campaign.drives)
    assert made.sessions == real.campaign.sessions
    assert made.metadata.sigma_position_m == pytest.approx(5e-5)
    for cell, shown in (("far", "far"), ([1.0, None], r"\[1.0, None\]")):
        column = [*frame["x_m"][:2], cell, *frame["x_m"][3:]]
        with pytest.raises(CampaignError, match=f"line 3, column 'x_m': '{shown}' is not a usable number"):
            Campaign.from_frame(frame.assign(x_m=column), {})
    with pytest.raises(BadInputError, match="the path of a campaign is the one its table would have, not a None"):
        Campaign.from_frame(frame, {}, path=None)
    with pytest.raises(DescriptionError, match=r"unknown key 'metrology.sigma'"):
        Campaign.from_frame(frame, {"metrology": {"sigma": 1.0}})


def test_what_a_file_may_not_hold_a_campaign_does_not(real, tmp_path):
    campaign = real.campaign
    for name, value, said in (
        ("payload", -5.0, "row 1 of the campaign, payload_kg: -5 kg is not a possible load"),
        ("leg1", 9999.0, "leg1_degC: 9999 degC is hotter than any melt"),
        ("time", np.inf, "time_s: it must be finite, or NaN where it is unknown"),
        ("payload", "heavy", "'payload' of the campaign must be numbers"),
    ):
        with pytest.raises(BadInputError, match=said):
            campaign.with_conditions(**{name: [value] * len(campaign)})
    far = campaign.position_m + 1e7
    with pytest.raises(BadInputError, match=r"x_m: 1e\+07 is larger than any quantity"):
        dataclasses.replace(campaign, position_m=far)
    since_1970 = campaign.with_conditions(time=np.arange(len(campaign)) + 1.7e9)
    assert Campaign.read(since_1970.save(tmp_path / "c.csv")[0]).time_s[0] == 1.7e9


@pytest.mark.parametrize("name", ["path", "metadata", "lines", "samples", "sessions", "drives", "position_m"])
def test_a_campaign_lacks_nothing(real, name):
    with pytest.raises(BadInputError, match="campaign"):
        dataclasses.replace(real.campaign, **{name: None})


def test_a_campaign_keeps_its_names_as_texts(real):
    rows = np.arange(len(real.campaign))
    given = dataclasses.replace(real.campaign, sessions=rows, distance_from=np.full(rows.size, ""))
    assert given.sessions[:2] == ("0", "1") and type(given.distance_from[0]) is str
    one = real.campaign.subset(rows[:1])
    assert dataclasses.replace(one, sessions="abc").sessions == ("abc",)
    for wrong in ({"samples": None}, {"sessions": [np.nan]}, {"samples": ["b", "c"]}, {"lines": [0.5]}):
        with pytest.raises(BadInputError, match=r"is a text, not a|needs as many|are whole numbers"):
            dataclasses.replace(one, **wrong)


@pytest.mark.parametrize("path", [None, 5, [1.0]])
def test_a_campaign_is_read_from_a_path(path):
    with pytest.raises(
        BadInputError, match=r"from_frame takes a data frame; read takes the path of a table, not a \w+$"
    ):
        Campaign.read(path)


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda one: pickle.loads(pickle.dumps(one))], ids=["copy", "pickle"])
def test_robots_and_campaigns_go_to_other_processes(real, as_built, copied):
    campaign, robot, pose = copied(real.campaign), copied(as_built), PlatformPose.from_mm_deg(-100, 20, -600, 17)
    assert campaign.to_frame().equals(real.campaign.to_frame())
    with pytest.raises(TypeError):
        campaign.conditions["payload"] = 0.0
    assert robot.model == as_built.model and robot.accuracy_m == as_built.accuracy_m
    np.testing.assert_array_equal(robot.transfer(pose), as_built.transfer(pose))
