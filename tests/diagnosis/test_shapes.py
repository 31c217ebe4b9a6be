"""The learned shape of an effect against that of the independent machine, which is not the textbook's."""

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.axes import Axes

from pouring_robot.campaign.data import Campaign
from pouring_robot.diagnosis.diagnose import diagnose
from pouring_robot.diagnosis.discrepancy_processes import varied
from pouring_robot.diagnosis.learned_shape import shape_of
from pouring_robot.diagnosis.report.plots import plots
from pouring_robot.estimation.noise import Noise, NoiseLevel
from pouring_robot.inference.gaussian_processes.processes import Channel, sums_of
from tests.rig import Wanted, make_campaign, write_case

LAG_S = 500.0


def hidden(folder, form):
    """Diagnose legs that expand, and return the result with the campaign of the rig."""
    how = {"sessions": 1, "background": False, "full_pose": True, "spoilt": False, "rows": 70}
    made = make_campaign("single", 5, wanted=(Wanted("leg_thermal_expansion", 8.0, form),), **how)
    return made, diagnose(Campaign.read(write_case(folder, made) / "campaign.csv"))


@pytest.fixture(scope="module")
def core(tmp_path_factory):
    return hidden(tmp_path_factory.mktemp("core"), "b")


def grown_mm(made, leg):
    """Expansion of a leg: its core follows skin and platform with a time constant, integrated row by row."""
    table = {name: np.array([float(row[name]) for row in made.rows]) for name in made.rows[0]}
    around = 0.85 * table[f"leg{leg}_degC"] + 0.15 * table["platform_degC"]
    core = around.copy()
    for k, step in enumerate(np.diff(table["time_s"]), 1):
        core[k] = around[k] + (core[k - 1] - around[k]) * np.exp(-step / LAG_S)
    size = made.truth["effects"][0]["size"]
    return 1e-5 * size * table[f"q{leg}_mm"] * (core - made.settings["reference_temperature_degC"])


def test_the_learned_shape_is_what_the_machine_does(core):
    made, found = core
    (effect,) = found.firm
    shape = shape_of(found, effect)
    assert (effect.cause.effect, shape.unit) == ("leg_thermal_expansion", "mm")
    true = grown_mm(made, int(shape.channel.removeprefix("drive.leg")[0]))
    off = {name: np.sqrt(np.mean((getattr(shape, name) - true) ** 2)) for name in ("learned", "textbook")}
    assert off["learned"] < 0.2 * off["textbook"]
    assert np.mean(np.abs(shape.learned - true) < 4.0 * shape.std) > 0.9


def test_the_band_is_as_wide_as_the_standard_deviations_of_the_parameters(core, monkeypatch):
    """By the larger of two covariances; drawn by Student's t, 2.57 deviations at five degrees of freedom."""
    found = core[1]
    (effect,) = found.firm
    own = found.final.hypothesis.coefficients()[1]
    wider = replace(found, covariances=(0.25 * own, own), noise=NoiseLevel({"position": Noise(1e-4, "repeats", 5.0)}))
    std, drawn = shape_of(found, effect).std, []
    np.testing.assert_allclose(shape_of(wider, effect).std, std, rtol=1e-9)
    bar = Axes.errorbar
    monkeypatch.setattr(Axes, "errorbar", lambda *told, **how: drawn.append(told[3]) or bar(*told, **how))
    plots(wider)
    np.testing.assert_allclose(np.sort(drawn[0]), np.sort(2.5706 * std), rtol=1e-4)


def test_it_is_drawn_next_to_the_textbooks_shape(core):
    drawn = dict(plots(core[1]))
    assert "main parameters alone" in next(svg for title, svg in drawn.items() if title.startswith("What each effect"))


def test_a_shape_within_chance_of_the_textbooks_is_none(core):
    """The covariance is scaled until the shaping part is 1.9, then 2.1 of its standard deviations, RMS."""
    found = core[1]
    (effect,) = found.firm
    shape, units = shape_of(found, effect), found.units_of(effect)
    parameters = [one.parameter for one in effect.parameters]
    moves = np.column_stack([np.broadcast_to(p.changes.get(shape.channel, 0.0), shape.std.shape) for p in parameters])
    shaping = moves @ (np.array([not p.main for p in parameters])[:, None] * units)
    own = found.covariances[0]
    size = np.sqrt(np.mean(((shape.learned - shape.textbook) * 1e-3) ** 2))
    spread = np.sqrt(np.mean(np.einsum("nk,kl,nl->n", shaping, own, shaping)))
    for times, drawn in ((1.9, False), (2.1, True)):
        scaled = replace(found, covariances=((size / spread / times) ** 2 * own,))
        assert (shape_of(scaled, effect) is not None) is drawn


def test_a_textbook_effect_has_no_learned_shape(tmp_path):
    _, found = hidden(tmp_path, "c")
    assert [shape_of(found, effect) for effect in found.firm] == [None]


def test_what_an_effect_adds_is_the_same_from_its_parameters_and_from_the_columns_of_the_search(core):
    found = core[1]
    state, hypothesis = found.diagnoser.found(found.hypothesis)
    added = found.diagnoser.added(hypothesis, "leg_thermal_expansion", state.linear)
    part = sum(hypothesis.part(k) for k in hypothesis.of_effect("leg_thermal_expansion"))
    np.testing.assert_allclose(hypothesis.problem.nuisance.cleared(added.column), part, atol=1e-6 * np.abs(part).max())


def test_its_size_may_vary_by_a_tenth_with_each_condition(core):
    found = core[1]
    row = found.after.fitted_rows.row
    added = np.arange(1.0, len(row) + 1.0)
    channel = Channel("leg_thermal_expansion", added, sums_of(row, len(found.rows)))
    processes = list(varied(channel, found.rows.conditions))
    assert {"time", "order", "leg temperatures", "pose", "side of approach"} <= {one.by for one in processes}
    for (part,) in (parts for one in processes for parts in one.lengths.values()):
        assert part.rms == pytest.approx(0.1)
        np.testing.assert_array_equal(part.channel.column, added)
