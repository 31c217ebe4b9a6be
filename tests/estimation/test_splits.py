"""Held-out blocks: whole ones that the others can predict, the test block apart; measured values play no part."""

import dataclasses

import numpy as np
import pytest

from pouring_robot.campaign.data import Campaign
from pouring_robot.estimation.noise import repeats
from pouring_robot.estimation.splits import _KNOWN, _frame_columns, _inner_products, blocks, frames_determined, split
from pouring_robot.exceptions import BadInputError, CalibrationError
from pouring_robot.robot.description.definition import RobotDefinition
from tests.campaign.simulated import damaged, write_text
from tests.support import gantry_file

NONE = np.zeros(0, dtype=np.intp)


def test_blocks_cover_every_row_once(clean):
    for kind in ("region", "time"):
        parts = split(clean.campaign, np.array([3, 7]), kind)
        assert sorted([*parts.train, *parts.test]) == sorted(set(range(60)) - {3, 7})
        for train, judged in parts.validations:
            assert not set(train) & set(judged)
            assert not set(parts.test) & ({*train} | {*judged})


def test_rows_without_a_drive_value_are_in_no_region_and_change_none(clean):
    drives = clean.campaign.drives.copy()
    drives[5, 2] = np.nan
    lacking = dataclasses.replace(clean.campaign, drives=drives)
    whole = blocks(clean.campaign, "region", np.array([5]))
    assert {name: rows.tolist() for name, rows in blocks(lacking, "region", NONE).items()} == {
        name: rows.tolist() for name, rows in whole.items()
    }


def test_blocks_by_time_are_judged_forwards(clean):
    parts = split(clean.campaign, NONE, "time")
    assert parts.test.min() > parts.train.max()
    for train, judged in parts.validations:
        assert train.max() < judged.min()


def test_sessions_are_blocks_where_there_are_four(clean):
    sessions = tuple(str(k // 15) for k in range(60))
    campaign = dataclasses.replace(clean.campaign, sessions=sessions)
    parts = split(campaign, NONE)
    assert parts.kind == "session"
    assert parts.test.tolist() == list(range(45, 60))
    assert split(clean.campaign, NONE).kind == "region"


def test_with_sessions_of_single_rows_blocks_are_regions(clean):
    campaign = dataclasses.replace(clean.campaign, sessions=tuple(str(k) for k in range(60)))
    assert split(campaign, NONE).kind == "region"
    with pytest.raises(CalibrationError, match="choose --hold-out region"):
        split(campaign, NONE, "session")


def test_measured_values_play_no_part(clean):
    moved = damaged(clean.campaign, position_m=lambda p: p[::-1] + 5.0)
    first, second = split(clean.campaign, NONE), split(moved, NONE)
    np.testing.assert_array_equal(first.test, second.test)


def test_too_few_rows_are_refused(clean):
    with pytest.raises(CalibrationError, match="held-out blocks by region need"):
        split(clean.campaign.subset(range(12)), NONE)


def test_whether_few_rows_can_be_split_does_not_depend_on_their_order(clean):
    """Of 16 rows two regions have two, too few for a test: one with four is held out, whichever comes last."""
    random = np.random.default_rng(0)
    few = clean.campaign.subset(range(16))
    assert sorted(rows.size for rows in blocks(few, "region").values()) == [2, 2, 4, 4, 4]
    for _ in range(10):
        parts = split(few.subset(random.permutation(16)), NONE)
        assert (parts.test.size, parts.train.size) == (4, 12)


def test_blocks_are_whole(real):
    campaign = real.campaign
    for kind, count in (("time", 5), ("region", 5), ("session", 1)):
        found = blocks(campaign, kind)
        assert len(found) == count
        together = np.concatenate(list(found.values()))
        assert sorted(together.tolist()) == list(range(len(campaign)))
    assert [rows.size for rows in blocks(campaign, "time").values()] == [16] * 5
    with pytest.raises(BadInputError):
        blocks(campaign, "colour")


def test_repeats_of_a_pose_stay_in_one_region(real):
    """Also where their commands differ by less than the tolerance for repeats in the noise."""
    twice = real.campaign.subset(np.concatenate([np.arange(41), np.arange(41)]))
    drives = np.round(twice.drives, 6)
    drives[41:] += 4e-7
    twice = dataclasses.replace(twice, drives=drives)
    assert sum(len(group) for group in repeats(twice, np.arange(82))) == 82
    for rows in blocks(twice, "region").values():
        assert {int(row) % 41 for row in rows} == {int(row) for row in rows if row < 41}


def turned_over(folder, over):
    """Write and read positions of a tool on a gantry whose last head turns it over in some rows, a mask (60,)."""
    robot = gantry_file(folder)
    urdf = (folder / "gantry.urdf").read_text(encoding="utf-8").removesuffix("</robot>")
    head = '<link name="tool"/><joint name="head" type="continuous"><parent link="z"/><child link="tool"/>'
    (folder / "gantry.urdf").write_text(f'{urdf}{head}<axis xyz="1 0 0"/></joint></robot>', encoding="utf-8")
    text = robot.read_text(encoding="utf-8").replace("end_frame: z\n", "end_frame: tool\n")
    robot.write_text(text.replace("}]", "}, {joint: head}]"), encoding="utf-8")
    slides = np.random.default_rng(1).uniform(0.0, [1.8, 1.5, 0.8], size=(60, 3))
    slides[over] = [1.9, 1.4, 0.7] + 0.1 * slides[over]  # in one corner
    places = slides + np.where(over[:, None], [0.0, 0.0, -0.1], [0.0, 0.0, 0.1])
    rows = np.column_stack([slides, np.pi * over, places]).tolist()
    header = "x_slide_m,y_slide_m,z_slide_m,head_rad,x_m,y_m,z_m"
    table = write_text(folder, header, [",".join(map(repr, row)) for row in rows])
    return Campaign.read(table, RobotDefinition.load(robot))


def test_a_block_that_alone_determines_tracker_and_target_is_not_held_out(tmp_path):
    over = np.arange(60) >= 52
    campaign = turned_over(tmp_path, over)
    alone = [name for name, rows in blocks(campaign, "region").items() if over[rows].any()]
    assert alone == ["region 5 of 5"]  # it would come last
    parts = split(campaign, NONE)
    assert (parts.test_name, over[parts.test].any()) == ("region 4 of 5", False)
    assert len(parts.folds) == 4
    assert len(parts.validations) == 3  # those rows judge nothing either
    assert not any(over[judged].any() for _, judged in parts.validations)
    with pytest.raises(CalibrationError, match="no last block by time can be held out, as it alone determines"):
        split(campaign, NONE, "time")


def test_frame_directions_that_no_row_determines_forbid_no_block(tmp_path):
    """Base and tool of a gantry that never rotates are confounded, whatever the rows."""
    assert split(turned_over(tmp_path, np.zeros(60, dtype=bool)), NONE).test_name == "region 5 of 5"


@pytest.mark.parametrize("where", [slice(0, 20), slice(40, 60)])
def test_sessions_with_frames_of_their_own_are_determined_one_by_one(clean, where):
    """If all rows of a session are held out, nothing gives the tracker's position in it."""
    sessions = np.full(60, "a")
    sessions[where] = "b"
    metadata = clean.campaign.metadata.model_copy(update={"frames": "per session"})
    campaign = dataclasses.replace(clean.campaign, sessions=tuple(sessions.tolist()), metadata=metadata)
    frames, own = _frame_columns(campaign), np.zeros(60, dtype=bool)
    own[where] = True
    assert frames.shape == (60, 6, 18)
    assert not frames_determined([_inner_products(frames[~own])], _inner_products(frames[own]))
    assert frames_determined([_inner_products(frames[::2])], _inner_products(frames[1::2]))


def test_a_share_is_that_of_the_least_determined_direction():
    """With columns orthonormal over all rows a squared singular value is a share; undetermined directions have none."""
    axes = np.linalg.qr(np.random.default_rng(2).normal(size=(40, 4)))[0]
    known = set()
    for rows in range(4, 40):
        first, *_, second = np.array_split(axes[:rows], 2) if rows > 4 else (axes[:2], axes[2:4])
        scaled = (part[:, None] * [1e3, 1.0, 1.0, 1e-3] for part in (first, second, axes[rows:]))
        padded = [np.pad(_inner_products(part), ((0, 1), (0, 1))) for part in scaled]
        share = np.linalg.svd(axes[:rows], compute_uv=False).min() ** 2
        assert frames_determined(padded[:2], padded[2]) == (share >= _KNOWN)
        known.add(share >= _KNOWN)
    assert known == {False, True}
