"""Missing cells: which of them other rows determine, and which rows are left out."""

import dataclasses

import numpy as np
import pytest

from pouring_robot.effects.missing_cells import filled_in, rows_without


def test_a_condition_is_not_extrapolated_long_after_its_last_value(bench):
    """Three rows are filled, and a constant is; an hour of the last reading would be a furnace that stood still."""
    leg1 = np.linspace(20.0, 40.0, len(bench.campaign))
    ended, almost, same = leg1.copy(), leg1.copy(), np.full(len(leg1), 20.0)
    ended[-4:], almost[-3:], same[1:] = np.nan, np.nan, np.nan
    found = rows_without(bench.campaign.with_conditions(leg1=ended, leg2=almost, leg3=same))
    assert list(found) == ["leg1_degC"]
    np.testing.assert_array_equal(found["leg1_degC"], np.arange(len(leg1) - 4, len(leg1)))


def test_a_load_is_filled_in_between_two_equal_ones_where_loads_stay_constant(bench):
    """With blocks of ten rows, none between two blocks is; where each row has a load of its own, none at all."""
    rows = np.arange(len(bench.campaign))
    blocks, own = 10.0 * (rows // 10 % 3), np.random.default_rng(1).uniform(0.0, 20.0, len(rows))
    for payload, left in ((blocks, [29]), (own, [4, 15, 29])):
        gappy = np.array(payload)
        gappy[[4, 15, 29]] = np.nan
        campaign = bench.campaign.with_conditions(payload=gappy)
        (found,) = rows_without(campaign).values()
        np.testing.assert_array_equal(found, left)
        told = np.setdiff1d([4, 15, 29], left)
        np.testing.assert_allclose(filled_in(campaign, "payload")[told], payload[told])


@pytest.mark.parametrize("turned", [False, True])
def test_the_side_of_approach_is_not_guessed(bench, turned):
    """It is unknown where sides change from row to row, and known where all rows of a drive but one have the same."""
    sides = np.array(bench.campaign.approach)
    sides[:, 1] = np.where(np.arange(len(sides)) == 20, -1.0, 1.0)
    sides[9, 1] = np.nan
    if turned:
        sides[:, 1] = np.random.default_rng(2).choice([-1.0, 1.0], len(sides))
        sides[9, 1] = np.nan
    found = rows_without(dataclasses.replace(bench.campaign, approach=sides))
    assert {name: rows.tolist() for name, rows in found.items()} == ({"approach_q2": [9]} if turned else {})


def test_the_side_of_approach_of_a_first_row_is_unknown(bench):
    """The metadata state that each row is approached from the row before."""
    sides = np.array(bench.campaign.approach)
    sides[[0, 7]], sides[9, 1] = np.nan, np.nan
    metadata = bench.campaign.metadata.model_copy(update={"approach": "row before"})
    stated = dataclasses.replace(bench.campaign, approach=sides, metadata=metadata)
    (rows,) = rows_without(stated).values()
    np.testing.assert_array_equal(rows, [0, 7])
    assert not rows_without(dataclasses.replace(stated, approach=np.full(sides.shape, np.nan)))


def test_a_session_whose_clock_restarts_does_not_fill_another(bench):
    """A missing cell is filled from neighbours in its own session, not from rows of other sessions at such a time."""
    half = len(bench.campaign) // 2
    session = np.arange(len(bench.campaign)) // half
    time, leg1 = 60.0 * (np.arange(len(session)) % half), 20.0 + 100.0 * session
    leg1[[7, half + 7]] = np.nan
    names = tuple(f"day {number}" for number in session)
    campaign = dataclasses.replace(bench.campaign.with_conditions(leg1=leg1, time=time), sessions=names)
    np.testing.assert_array_equal(filled_in(campaign, "leg1"), 20.0 + 100.0 * session)
