"""Held-out blocks: whole ones, the test block apart, and what was measured plays no part."""

import dataclasses

import numpy as np
import pytest

from pouring_robot.estimation.splits import blocks, split
from pouring_robot.exceptions import BadInputError, CalibrationError
from tests.campaign.simulated import damaged

NONE = np.zeros(0, dtype=np.intp)


def test_blocks_cover_every_row_once(clean):
    for kind in ("region", "time"):
        parts = split(clean.campaign, np.array([3, 7]), kind)
        assert sorted([*parts.train, *parts.test]) == sorted(set(range(60)) - {3, 7})
        for train, judged in parts.validations:
            assert not set(train) & set(judged)
            assert not set(parts.test) & ({*train} | {*judged})


def test_time_is_judged_forwards(clean):
    parts = split(clean.campaign, NONE, "time")
    assert parts.test.min() > parts.train.max()
    for train, judged in parts.validations:
        assert train.max() < judged.min()


def test_sessions_serve_where_there_are_four(clean):
    sessions = tuple(str(k // 15) for k in range(60))
    campaign = dataclasses.replace(clean.campaign, sessions=sessions)
    parts = split(campaign, NONE)
    assert parts.kind == "session"
    assert parts.test.tolist() == list(range(45, 60))
    assert split(clean.campaign, NONE).kind == "region"


def test_sessions_of_single_rows_give_way_to_regions(clean):
    campaign = dataclasses.replace(clean.campaign, sessions=tuple(str(k) for k in range(60)))
    assert split(campaign, NONE).kind == "region"
    with pytest.raises(CalibrationError, match="choose --hold-out region"):
        split(campaign, NONE, "session")


def test_measurements_play_no_part(clean):
    moved = damaged(clean.campaign, position_m=lambda p: p[::-1] + 5.0)
    first, second = split(clean.campaign, NONE), split(moved, NONE)
    np.testing.assert_array_equal(first.test, second.test)


def test_too_few_rows_are_refused(clean):
    with pytest.raises(CalibrationError, match="held-out blocks by region need"):
        split(clean.campaign.subset(range(12)), NONE)


def test_blocks_are_whole(real):
    campaign = real.campaign
    for kind, count in (("time", 5), ("region", 5), ("session", 1)):
        found = blocks(campaign, kind)
        assert len(found) == count
        together = np.concatenate(list(found.values()))
        assert sorted(together.tolist()) == list(range(len(campaign)))
    assert [rows.size for rows in blocks(campaign, "time", 4).values()] == [20, 20, 20, 20]
    with pytest.raises(BadInputError):
        blocks(campaign, "colour")
    with pytest.raises(BadInputError):
        blocks(campaign, "time", 1)


def test_repeats_of_a_pose_stay_in_one_region(real):
    campaign = real.campaign
    twice = campaign.subset(np.concatenate([np.arange(40), np.arange(40)]))
    for rows in blocks(twice, "region", 6).values():
        assert {int(row) % 40 for row in rows} == {int(row) for row in rows if row < 40}
