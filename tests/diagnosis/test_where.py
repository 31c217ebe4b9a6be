"""Where model and measurement disagree: the level under noise, errors among correlated causes, missing data."""

import dataclasses
import json

import numpy as np
import pytest
import scipy.stats
from scipy.spatial.transform import Rotation
from statsmodels.stats.multitest import multipletests

from pouring_robot.diagnosis.discrepancy_processes import _of_one_condition
from pouring_robot.diagnosis.where.free_residuals import FreeResiduals, size_text
from pouring_robot.diagnosis.where.misfit import overall
from pouring_robot.diagnosis.where.where import disagreements, holm
from pouring_robot.effects.conditions import Conditions
from pouring_robot.estimation.noise import LEAST_NOISE, Noise, NoiseLevel
from pouring_robot.exceptions import BadInputError
from pouring_robot.inference.gaussian_processes.discrepancy import Discrepancy
from pouring_robot.inference.gaussian_processes.processes import Channel, sums_of
from pouring_robot.inference.problem import Nuisance
from pouring_robot.mechanism.arrays import rms
from pouring_robot.robot.model import RobotModel

SIGMA_M, SIGMA_RAD = 5e-5, 3e-5
GUESSED = NoiseLevel({"position": Noise(source="residuals")})
NOTHING = {"approach": None, "weight_n": None, "drive_force": None, "travels": {}, "rises": {}}
ROBOT = RobotModel().definition
LEGS = ("leg1", "leg2", "leg3", "leg4")


def scene(rng, n=90, repeated=30, alike=0.0):
    """Conditions of n rows, the last of them repeats; temperatures follow time, and load follows time by ``alike``."""
    fresh = n - repeated
    again = np.concatenate([np.arange(fresh), np.arange(repeated)])
    position = rng.uniform([-0.15, -0.05, -0.825], [-0.05, 0.05, -0.425], (fresh, 3))[again]
    tilt = rng.uniform(-0.48, 1.08, fresh)[again]
    lengths = np.linalg.norm(position[:, None] + rng.normal(0.0, 0.1, (4, 3)), axis=2)
    time = np.cumsum(rng.uniform(60.0, 90.0, n))
    passed = (time - time[0]) / np.ptp(time)
    level = alike * passed + (1.0 - alike) * rng.random(n)
    approach = np.where(rng.random((n, 4)) < 0.5, -1.0, 1.0)
    travel = rng.uniform(0.0, 6.0, n)
    legs = 100.0 * passed[:, None] + rng.normal(0.0, 3.0, (n, 4))
    return Conditions(
        robot=ROBOT,
        drives=np.column_stack([lengths[:, :3], tilt]),
        position_m=position,
        rotation=Rotation.from_rotvec(np.outer(tilt, [0.0, 1.0, 0.0])).as_matrix(),
        session=(passed > 0.6).astype(np.intp),
        time_s=time,
        time_known=True,
        approach=approach,
        weight_n=9.80665 * (330.0 + 350.0 * level),
        travels={"truss_travel": travel},
        rises={
            "melt": np.where(np.arange(n) // 20 % 2 == 0, 1500.0, 380.0),
            "ambient": 5.0 * np.sin(4.0 * passed),
            **dict(zip(LEGS, legs.T, strict=True)),
            "platform": 80.0 * passed + rng.normal(0.0, 3.0, n),
        },
        screw_pitch_m=0.01,
        truss_span_m=6.0,
    )


def seen(rng, given, error=None, full=True, turned=0.4):
    """Residuals of displacements (n, 6) in the fixed platform's axes, seen by a rotated tracker."""
    n, width = len(given), 6 if full else 3
    axes = Rotation.from_euler("z", turned).as_matrix()
    row, component = np.divmod(np.arange(width * n), width)
    sigma = np.where(component < 3, SIGMA_M, SIGMA_RAD)
    frames = np.zeros((n, 6, 12))
    frames[:, :3, :3] = np.eye(3)
    frames[:, :3, 3:6] = -np.cross(np.eye(3), given.position_m[:, None]).transpose(0, 2, 1)
    frames[:, 3:, 3:6] = np.eye(3)
    frames[:, :3, 6:9], frames[:, 3:, 9:] = given.rotation, given.rotation
    arms = Rotation.from_matrix(axes)
    tracker = np.concatenate([np.einsum("ab,nbf->naf", arms.as_matrix(), frames[:, k : k + 3]) for k in (0, 3)], axis=1)
    free = tracker.reshape(6 * n, 12)[np.tile(np.arange(6) < width, n)] / sigma[:, None]
    directions = np.random.default_rng(8).normal(size=(6, 4)) * np.array([1, 1, 1, 0.3, 0.3, 0.3])[:, None]
    drives = tuple(Channel("", one, sums_of(row, n)) for one in (directions[component] / sigma[:, None]).T)
    residual = rng.normal(size=row.size)
    if error is not None:
        whole = np.concatenate([error[:, :3] @ axes.T, error[:, 3:] @ axes.T], axis=1)
        residual = residual + whole[row, component] / sigma
    return FreeResiduals(residual, row, component, sigma, Nuisance.of(free), axes, drives)


def moved(given, component, course):
    """Displacements (n, 6) of one component along a course (n,), in m or rad."""
    error = np.zeros((len(given), 6))
    error[:, component] = course
    return error


def conditions_found(where):
    """Conditions in the findings, most important first."""
    return [item.condition for item in where.findings if item.what == "condition"]


@pytest.mark.parametrize(("rows", "full"), [(90, True), (36, False)])
def test_noise_alone_seldom_raises_an_alarm(rows, full):
    rng = np.random.default_rng(2)
    given = scene(rng, rows, rows // 3)
    data = seen(rng, given, full=full)
    draws = [dataclasses.replace(data, residual=rng.normal(size=data.residual.size)) for _ in range(30)]
    alarms = sum(bool(disagreements(d, given, alpha=0.05).findings) for d in draws)
    assert alarms <= scipy.stats.binom.ppf(0.999, len(draws), 0.05)


def test_p_values_of_single_tests_are_uniform_under_noise():
    """Half of all noise lies below the median: corrections must not hide tests that never reject."""
    rng = np.random.default_rng(3)
    given = scene(rng)
    data = seen(rng, given)
    draws = [dataclasses.replace(data, residual=rng.normal(size=data.residual.size)) for _ in range(60)]
    p_values = np.array([overall(d, d.residual.size - d.nuisance.dof).p_value for d in draws])
    assert scipy.stats.kstest(p_values, "uniform").pvalue > 1e-3


def test_load_is_named_although_time_and_temperatures_are_correlated_with_it():
    rng = np.random.default_rng(4)
    given = scene(rng, alike=0.6)
    assert np.corrcoef(given.weight_n, given.time_s)[0, 1] > 0.7
    load = (given.weight_n - given.weight_n.min()) / np.ptp(given.weight_n)
    where = disagreements(seen(rng, given, moved(given, 1, 4e-4 * load)), given, 0.01)
    assert conditions_found(where) == ["load"]
    (item,) = [f for f in where.findings if f.what == "condition"]
    assert item.component == "y"
    assert not item.rivals
    assert item.size == pytest.approx(4e-4 * load.std(), rel=0.1)
    assert "Grows with load from " in item.sentence
    assert ": y by 0." in item.sentence
    assert "time" in item.sentence.partition("; no more than ")[2]
    components = [f.component for f in where.findings if f.what == "component"]
    assert components == ["y"]


@pytest.mark.parametrize(("dof", "halves"), [(np.inf, ("0.020", "0.039")), (12.0, ("0.022", "0.044"))])
def test_sizes_are_reported_with_half_of_their_95_percent_interval(monkeypatch, dof, halves):
    """1.96 standard deviations, as wherever there is a ±; 2.18, Student's t, at twelve degrees of freedom."""
    summed = Discrepancy.sum

    def known(*asked):
        items = summed(*asked)
        sizes = zip(items, (4e-4, 3e-4), (1e-5, 2e-5), strict=True)
        return [
            dataclasses.replace(i, movement=i.movement * m / rms(i.movement), std=np.full_like(i.std, s))
            for i, m, s in sizes
        ]

    monkeypatch.setattr(Discrepancy, "sum", known)
    rng = np.random.default_rng(4)
    given = scene(rng)
    load = (given.weight_n - given.weight_n.min()) / np.ptp(given.weight_n)
    error = moved(given, 1, 5e-4 * load) + moved(given, 2, 4e-4 * load)
    noise = NoiseLevel({"position": Noise(SIGMA_M, "repeats", dof)})
    where = disagreements(dataclasses.replace(seen(rng, given, error), noise=noise), given, 0.01)
    (sentence,) = [f.sentence for f in where.findings if f.what == "condition"]
    assert f": y by 0.400 ± {halves[0]} mm and z by 0.300 ± {halves[1]} mm (rms, 95 %)" in sentence


def test_time_and_load_are_both_named():
    rng = np.random.default_rng(5)
    given = scene(rng)
    passed = given.elapsed
    load = (given.weight_n - given.weight_n.min()) / np.ptp(given.weight_n)
    error = moved(given, 2, 5e-4 * load) + moved(given, 0, 5e-4 * passed**2)
    bare = dataclasses.replace(given, rises={"melt": given.rises["melt"]})
    where = disagreements(seen(rng, given, error), bare, 0.01)
    assert set(conditions_found(where)) == {"load", "time"}


def test_an_exactly_correlated_condition_is_named_as_a_rival():
    rng = np.random.default_rng(6)
    given = scene(rng)
    rises = {name: given.rises[name] for name in ("melt", "ambient")}
    given = dataclasses.replace(given, travels={"truss_travel": 1.0 + 3.0 * given.elapsed}, rises=rises)
    where = disagreements(seen(rng, given, moved(given, 2, 5e-4 * given.elapsed)), given, 0.01)
    (item,) = [f for f in where.findings if f.what == "condition"]
    assert {item.condition, *item.rivals} >= {"time", "truss travel"}
    assert "varied with it" in item.sentence
    assert set(item.figures()["or"]) == set(item.rivals)


def test_side_of_one_drive_is_found_on_that_drive():
    rng = np.random.default_rng(7)
    given = scene(rng)
    data = seen(rng, given)
    data = dataclasses.replace(
        data, residual=data.residual + data.drives[1].column * 6e-5 * given.approach[data.row, 1]
    )
    where = disagreements(data, given, 0.01)
    assert conditions_found(where) == ["side of approach"]
    (item,) = [f for f in where.findings if f.what == "condition"]
    assert item.size == pytest.approx(6e-5, rel=0.15)
    assert item.component == "l2"


@pytest.mark.parametrize(("waves", "said"), [(0.0, "on a scale of 50 mm or more"), (4.0, "on a scale of 20 mm")])
def test_dependence_on_a_drives_own_length_is_not_called_periodic(waves, said):
    """The dependence is smooth on a scale, as a straight line is, and need not be periodic."""
    rng = np.random.default_rng(7)
    given = scene(rng)
    drives, along = given.drives.copy(), rng.random(len(given))
    drives[:, 1] = 0.2 * along
    given = dataclasses.replace(given, drives=drives)
    data = seen(rng, given)
    course = np.sin(2.0 * np.pi * waves * along) if waves else along - 0.5
    data = dataclasses.replace(data, residual=data.residual + data.drives[1].column * 3e-4 * course[data.row])
    (item,) = [f for f in disagreements(data, given, 0.01).findings if f.what == "condition"]
    assert item.sentence.startswith(f"Varies along its own length, {said}: leg 2 by ")


@pytest.mark.parametrize(("slower", "unit", "unit_s"), [(1.0, "min", 60.0), (1500.0, "d", 86400.0)])
def test_waves_of_two_periods_are_distinguished(slower, unit, unit_s):
    """A pump and a door: what one of them moves is not periodic with the other."""
    rng = np.random.default_rng(5)
    given = scene(rng)
    given = dataclasses.replace(given, time_s=slower * given.time_s)
    passed = 2.0 * np.pi * (given.time_s - given.time_s[0]) / np.ptp(given.time_s)
    error = moved(given, 0, 4e-4 * np.sin(4.0 * passed)) + moved(given, 2, 3e-4 * np.sin(13.0 * passed))
    found = [f.sentence for f in disagreements(seen(rng, given, error), given, 0.01).findings if f.what == "condition"]
    assert [one.split(":")[1].split()[0] for one in found] == ["x", "z"]
    for cycles, one in zip((4.0, 13.0), found, strict=True):
        periods = one.removeprefix("Cycles with time, once in ").split(f" {unit}:")[0]
        least, most = map(float, periods.split(" to "))
        assert least <= np.ptp(given.time_s) / unit_s / cycles <= most


def test_a_region_is_named_in_words_and_repeats_raise_no_alarm():
    rng = np.random.default_rng(8)
    given = scene(rng, 120, 40)
    low = given.position_m[:, 2] < np.quantile(given.position_m[:, 2], 1 / 3)
    bump = np.where(low, np.sin(90.0 * given.position_m[:, 0]) * np.cos(150.0 * given.position_m[:, 1]), 0.0)
    where = disagreements(seen(rng, given, moved(given, 1, 4e-4 * bump)), given, 0.01)
    region = next(f for f in where.findings if f.what == "region")
    assert region.condition.startswith("low")
    assert not any(f.what == "repeats" for f in where.findings)


@pytest.mark.parametrize("noise_known", [True, False])
def test_an_unexplained_error_of_one_component_accuses_no_other(noise_known):
    """A ripple that no condition describes, twenty times the noise, in y only."""
    rng = np.random.default_rng(9)
    given = scene(rng, 120, 0)
    false = 0
    for _ in range(4):
        ripple = 1e-3 * rng.choice([-1.0, 1.0], len(given))
        data = dataclasses.replace(
            seen(rng, given, moved(given, 1, ripple)), noise=NoiseLevel({}) if noise_known else GUESSED
        )
        false += conditions_found(disagreements(data, given, 0.01)) != ["row, by chance"]
    assert false <= 1


@pytest.mark.parametrize("full", [True, False])
def test_absent_and_constant_conditions(full):
    rng = np.random.default_rng(10)
    given = scene(rng)
    none = dataclasses.replace(given, **NOTHING, time_known=False, session=np.zeros(len(given), dtype=np.intp))
    data = seen(rng, given, moved(given, 2, 1e-3 * given.position_m[:, 0] ** 2 / 0.15**2), full=full)
    where = disagreements(data, none, 0.01)
    assert conditions_found(where)[0] == "pose"
    assert "load" in where.sentences[-1]
    rises = {**given.rises, "melt": np.full(len(given), 1.0)}
    constant = dataclasses.replace(given, weight_n=np.full(len(given), 5000.0), rises=rises)
    *found, last = disagreements(data, constant, 0.01).sentences
    assert "load, melt temperature" in last
    bounded = " ".join(found).partition("; no more than ")[2]
    assert "platform temperature" in bounded
    assert not any(word in bounded for word in ("melt", "load"))
    courses = {by for by, _ in _of_one_condition(constant)}
    assert courses.isdisjoint({"load", "melt temperature"})
    assert {"platform temperature", "truss travel"} <= courses
    json.dumps(where.figures(), allow_nan=False)
    assert {"what", "component", "condition", "p_value", "sentence"} <= set(where.figures()[0])


@pytest.mark.parametrize("wrong", [7.0, 0.1])
def test_unknown_noise_allows_no_test_of_size_but_dependence_is_found(wrong, monkeypatch):
    rng = np.random.default_rng(11)
    given = scene(rng)
    data = seen(rng, given, moved(given, 1, 5e-4 * np.sin(given.travels["truss_travel"])))
    drives = tuple(dataclasses.replace(one, column=one.column / wrong) for one in data.drives)
    guessed = dataclasses.replace(
        data, residual=data.residual / wrong, sigma=wrong * data.sigma, drives=drives, noise=GUESSED
    )
    where = disagreements(guessed, given, 0.01)
    assert all(f.p_value is None for f in where.findings if f.what in ("lack of fit", "component"))
    assert conditions_found(where) == ["truss travel"]
    size = next(f.size for f in where.findings if f.what == "condition")
    assert size == pytest.approx(5e-4 * np.sin(given.travels["truss_travel"]).std(), rel=0.15)
    assert not any("did not settle" in note for note in where.notes)
    monkeypatch.setattr("pouring_robot.diagnosis.where.dependence._NOISE_ROUNDS", 1)
    assert any("did not settle" in note for note in disagreements(guessed, given, 0.01).notes)


def test_each_kind_of_reading_has_its_own_noise():
    rng = np.random.default_rng(21)
    data = seen(rng, scene(rng))
    component = np.where(data.component == 2, 6, data.component)  # every third position is a distance
    std = np.select([component < 3, component < 6], [2.0, 5.0], 9.0)
    left = rng.normal(0.0, std)
    found = dataclasses.replace(data, component=component, noise=GUESSED).scaled(left)
    # From 90 values a root mean square is known to 7.5 %.
    np.testing.assert_allclose(found.sigma, std * data.sigma, rtol=4 * 0.075)


def test_degrees_of_freedom_that_frames_spend_in_few_rows_do_not_lower_the_noise():
    """With 14 positions the frames leave 33 of 42 degrees of freedom: the residual RMS is 0.89 of the noise."""
    rng = np.random.default_rng(22)
    data = dataclasses.replace(seen(rng, scene(rng, 14, 0), full=False), noise=GUESSED)
    draws = [dataclasses.replace(data, residual=rng.normal(size=42)) for _ in range(400)]
    variances = [np.square(draw.scaled(draw.cleared).sigma[0] / SIGMA_M) for draw in draws]
    assert np.mean(variances) == pytest.approx(1.0, abs=3.0 * np.sqrt(2.0 / 33.0 / 400.0))


def test_a_kind_whose_values_the_frames_fit_exactly_has_hardly_any_noise():
    rng = np.random.default_rng(23)
    data = seen(rng, scene(rng, 20, 0))
    alone = np.flatnonzero((data.component < 3) | (data.row == 0))  # one rotation, which turns the target
    kept = (data.residual[alone], data.row[alone], data.component[alone], data.sigma[alone])
    data = FreeResiduals(*kept, Nuisance.of(data.nuisance.axes[alone]), data.axes, (), GUESSED)
    turned = data.scaled(data.cleared).sigma[data.turning]
    np.testing.assert_allclose(turned, LEAST_NOISE, rtol=1e-12)


def test_few_rows_and_missing_cells():
    rng = np.random.default_rng(12)
    given = scene(rng, 9, 3)
    data = seen(rng, given, moved(given, 1, 1e-3 * rng.normal(size=9)))
    where = disagreements(data, given, 0.01)
    assert "too few" in " ".join(where.sentences)
    assert not conditions_found(where)
    assert where.findings
    kept = np.setdiff1d(np.arange(data.residual.size), [1, 4, 20])
    frames = Nuisance.of(data.nuisance.axes[kept])
    lost = FreeResiduals(
        data.residual[kept],
        data.row[kept],
        data.component[kept],
        data.sigma[kept],
        frames,
        data.axes,
        tuple(Channel("", one.column[kept], sums_of(data.row[kept], 9)) for one in data.drives),
    )
    assert lost.cleared.size == data.cleared.size - 3
    assert disagreements(lost, given, 0.01).findings


def test_rows_that_the_frames_fit_exactly_are_refused():
    rng = np.random.default_rng(13)
    given = scene(rng, 9, 3)
    data = seen(rng, given)
    first = data.row < 2
    kept = data.residual[first], data.row[first], data.component[first], data.sigma[first]
    with pytest.raises(BadInputError, match="12 measured values"):
        FreeResiduals(*kept, Nuisance(np.eye(12)), data.axes, data.drives)
    with pytest.raises(BadInputError, match="must each have"):
        dataclasses.replace(data, row=data.row[1:])


def test_holm_is_that_of_statsmodels():
    p_values = np.random.default_rng(14).random(40) ** 4
    np.testing.assert_allclose(holm(p_values), multipletests(p_values, method="holm")[1], rtol=1e-14)
    assert holm(np.zeros(0)).size == 0


def test_noise_from_few_repeats_is_trusted_less():
    rng = np.random.default_rng(15)
    given = scene(rng)
    data = seen(rng, given)
    data = dataclasses.replace(data, residual=1.3 * data.residual)
    dof = data.residual.size - data.nuisance.dof
    stated = overall(data, dof).p_value
    estimated = overall(
        dataclasses.replace(data, noise=NoiseLevel({"position": Noise(SIGMA_M, "repeats", 12.0)})), dof
    ).p_value
    assert stated < 1e-6
    assert estimated > 0.05
    squares = data.p_value(50.0, 30.0)
    assert squares == pytest.approx(scipy.stats.chi2.sf(50.0, 30.0), rel=1e-12)


@pytest.mark.parametrize(
    ("size", "shown"),
    [(16.83e-3, "16.8 mm"), (0.56e-3, "0.56 mm"), (4.8e-5, "0.048 mm"), (4.7e-7, "0.00047 mm"), (0.0, "0.000 mm")],
)
def test_a_size_is_never_shown_as_nothing(size, shown):
    assert size_text(size) == shown
