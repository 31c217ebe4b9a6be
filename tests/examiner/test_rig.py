"""Faults act correctly, and are sized and distinguished by rules that hold for known displacements."""

import numpy as np
import pytest

from tests.examiner import conditions, faults, strangers
from tests.examiner.judge import Judge
from tests.examiner.machine import Springs, settle, start
from tests.examiner.rig import Fault, Rig, Sight


def quiet(seed):
    rng = np.random.default_rng(seed)
    return rng, Rig(rng, conditions.draw(rng), 0.0)


def law(effect, name, rng, scene):
    return faults.acting(next(f for n, _, f in faults.FORMS[effect] if n == name)(rng, scene))


def test_free_play_is_dragged_behind_or_pressed_by_the_load():
    approach, load = np.array([1, -1, 1, -1]), np.array([500.0, 500.0, 5000.0, -5000.0])
    assert faults.flank(approach, load, 1000.0).tolist() == [-1, 1, 1, -1]


def test_a_rising_drive_with_play_leaves_the_leg_short():
    rng, rig = quiet(11)
    rig.faults = [Fault("drive_backlash", "", law("drive_backlash", "free play held by friction", rng, rig.scene))]
    parts, _ = rig.rest(weight=False)
    short = parts.length - rig.scene.drives[:, :3]
    assert (short * rig.scene.approach[:, :3] <= 0).all()
    assert np.abs(short).max() > 0


def test_a_law_of_forces_is_met_as_a_spring_of_that_stiffness_would():
    rng, rig = quiet(12)
    rig.springs = Springs().stiffer(100)
    soft = law("leg_compliance", "nuts and bearings", rng, rig.scene)
    _, repeated = rig.rest([Fault("leg_compliance", "", soft, 0.2)])
    parts, _ = rig.rest([])
    k = 1 / (1 / rig.springs.spindle + 0.2 * 1e-3 / 5000)
    direct = settle(parts, start(rig.scene.pose), Springs(rig.springs.centre, rig.springs.cross, k, rig.springs.tilt))
    sag = np.abs(direct.p - settle(parts, start(rig.scene.pose), rig.springs).p).max()
    assert np.abs(repeated.p - direct.p).max() < 2e-3 * sag


def test_rails_sag_as_a_beam_does():
    """A point load on two supports, by Navier's series; a half wave is worth 1/n^4."""
    _, rig = quiet(13)
    scene = rig.scene
    parts = rig.built()
    law("truss_deflection", "rails on two supports", np.random.default_rng(1), scene)(parts, scene, None, 1.0)
    trolley = np.random.default_rng(1).uniform(300, 1500)
    load = (9.80665 * trolley + scene.weight) / 20000
    n, a = np.arange(1, 400), scene.travel[:, None] / scene.span
    waves = 96 / (np.pi * n) ** 4 * np.sin(np.pi * n * a)
    assert -parts.base[:, 2] == pytest.approx(1e-3 * load * np.sum(waves * np.sin(np.pi * n * a), axis=1), rel=1e-5)
    slope = np.sum(waves * np.pi * n * np.cos(np.pi * n * a), axis=1) / scene.span
    assert -parts.base[:, 3] == pytest.approx(1e-3 * load * slope, abs=1e-8)


def test_moved_frames_are_no_gap_and_a_known_gap_has_its_size():
    rng, rig = quiet(14)
    rig.scene.sigma, rig.scene.sigma_turn = 1e-4, None
    judge, sight = Judge(rig), rig.see([], weight=False)
    moved = Sight(sight.x + 1e-6 * rng.normal(size=3) + np.cross([1e-6, 2e-6, -1e-6], sight.x), sight.R)
    assert judge.ratio(sight, moved) < 1e-4
    shaken = Sight(sight.x + 1e-4 * rng.normal(size=sight.x.shape), sight.R)
    assert judge.ratio(sight, shaken) == pytest.approx(1.0, abs=0.25)


@pytest.mark.parametrize("effect", faults.FORMS)
def test_textbook_columns_explain_the_first_form_of_their_effect(effect):
    rng, rig = quiet(16)
    judge = Judge(rig)
    rig.springs = Springs().stiffer(100)
    before = rig.see([])
    fault = Fault(effect, "", faults.acting(faults.FORMS[effect][0][2](rng, rig.scene)), 1e-3)
    after = rig.see([fault])
    fault.size *= 3 / judge.ratio(before, after)
    gap = judge.gap(before, rig.see([fault]))
    dose_free = judge.free(judge.flat(judge.columns()[effect]))
    rest = gap - dose_free @ np.linalg.lstsq(dose_free, gap, rcond=1e-10)[0]
    assert np.linalg.norm(rest) < 0.12 * np.linalg.norm(gap)


def test_every_stranger_is_seen_by_some_campaign():
    for name, forms in strangers.FORMS.items():

        def shown(seed, name=name, forms=forms):
            rng, rig = quiet(seed)
            fault, _ = faults.draw(rng, rig.scene, name, forms)
            fault.size = 0.1
            return Judge(rig).ratio(rig.see([]), rig.see([fault]))

        assert any(shown(seed) > 1e-3 for seed in range(4)), name
