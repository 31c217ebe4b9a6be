"""The example of a user's effect: found by its pyproject, and diagnosed in data that hold it."""

import json
import os
import subprocess
import sys
import tomllib
from dataclasses import replace

import numpy as np
import pytest

from pouring_robot.diagnosis.amend import amended
from pouring_robot.diagnosis.diagnose import DiagnosisOptions, diagnose
from pouring_robot.diagnosis.suggest.next_measurements import separating_words, untestable_words
from pouring_robot.effects import Effect, all_effects
from pouring_robot.effects.condition_facts import sources
from pouring_robot.robot.model import RobotModel
from tests.effects.bench import Bench
from tests.effects.plugins import EXAMPLE, GROUP, installed_example
from tests.support import ROOT

ROBOTS = sorted((ROOT / "examples").glob("*/*/robot.yaml"))
WEAR_MM = {"l1_wear": 0.45, "l2_wear": -0.30, "l3_wear": 0.60}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The example as installed."""
    return installed_example(tmp_path_factory.mktemp("site"))


@pytest.fixture
def plugin(folder, monkeypatch):
    """The example's effect, found through its entry point."""
    monkeypatch.syspath_prepend(str(folder))
    yield all_effects()["screw_wear"]
    sys.modules.pop("screw_wear", None)


@pytest.fixture(scope="module")
def worn():
    """A hundred and ten noisy rows of a robot whose screws are worn at 600 mm: the exact closure with that effect."""
    sys.path.insert(0, str(EXAMPLE))
    try:
        from screw_wear import ScrewWear
    finally:
        sys.path.remove(str(EXAMPLE))
        sys.modules.pop("screw_wear", None)
    bench = Bench(rows=110, sessions=1, seed=17)
    form = ScrewWear().form("at_600_mm", bench.rows.conditions)
    values = np.array([WEAR_MM[p.name] for p in form.parameters])
    return bench.seen_as(bench.rows, bench.rows.changes(form.parameters, values), np.random.default_rng(8))


@pytest.fixture(scope="module")
def kept():
    """The results that are made once, though each test finds the plug-in anew."""
    return {}


@pytest.fixture
def found(plugin, worn, kept):
    if not kept:
        kept["found"] = diagnose(worn)
    return kept["found"]


def test_the_package_is_small_and_names_its_class():
    settings = tomllib.loads((EXAMPLE / "pyproject.toml").read_text(encoding="utf-8"))
    assert settings["project"]["entry-points"][GROUP] == {"screw_wear": "screw_wear:ScrewWear"}
    assert len((EXAMPLE / "screw_wear.py").read_text(encoding="utf-8").splitlines()) <= 40


def test_its_entry_point_is_found(plugin, bench):
    assert type(plugin).__module__ == "screw_wear"
    forms = plugin.forms(bench.rows.conditions)
    assert [form.name for form in forms] == ["at_500_mm", "at_600_mm", "at_700_mm"]
    for form in forms:
        for parameter in form.parameters:
            ((name, change),) = parameter.changes.items()
            assert name.startswith("drive.leg")
            assert change.shape == (len(bench.rows),)
            assert 0.0 < change.max() <= 1e-3


def test_the_command_lists_it(folder):
    """In a separate interpreter, as for a user."""
    paths = [str(folder), *filter(None, [os.environ.get("PYTHONPATH")])]
    command = [sys.executable, "-m", "pouring_robot", "effects", "--json"]
    done = subprocess.run(
        command, env=os.environ | {"PYTHONPATH": os.pathsep.join(paths)}, check=True, capture_output=True, text=True
    )
    assert "screw_wear" in json.dumps(json.loads(done.stdout))


@pytest.mark.parametrize("file", ROBOTS, ids=lambda file: file.parent.name)
def test_other_robots_are_without_it(plugin, file):
    robot = RobotModel.for_robot(file).definition
    assert plugin.id not in all_effects(robot)
    assert robot.name not in plugin.robots


def test_it_is_for_every_layout_of_the_robot(plugin):
    assert plugin.id in all_effects(RobotModel(layout="wide").definition)


def test_it_is_drawn_and_distinguished_like_a_built_in_effect(plugin, bench):
    """It depends on the lengths of the legs, as a wrong lead does: the same axis and the same suggestions."""
    effects, conditions = all_effects(), bench.rows.conditions
    own, lead = plugin.axis(conditions), effects["drive_scale"].axis(conditions)
    assert own.label == lead.label == "length of leg 1 [mm]"
    np.testing.assert_array_equal(own.values, lead.values)
    held = replace(conditions, drives=np.ones_like(conditions.drives))
    for given in (conditions, held):
        said = [separating_words(name, "base_drift", effects, given) for name in ("screw_wear", "drive_scale")]
        assert said[0] == said[1]
    assert said[0].startswith("measure with legs as short and as long as possible")


def test_an_effect_that_states_only_its_needs_has_words_too(bench):
    class Warped(Effect):
        id, story, needs = "warped", "the hall warms one side of the truss", ("ambient_rise_k",)

        def forms(self, conditions):
            return ()

    effect, conditions = Warped(), bench.rows.conditions
    assert effect.axis(conditions).label == "hall above reference [K]"
    assert "warm hall" in separating_words("warped", "none", {"warped": effect}, conditions)
    assert untestable_words({"warped": effect.needs}, conditions.robot) == (
        "record the temperature of the hall (ambient_degC): without it warped cannot be tested",
    )
    assert sources(effect.needs, conditions.robot) == ("ambient_degC",)


def test_diagnosis_names_it_with_its_values(plugin, found):
    assert found.judgement.verdict == "named"
    (named,) = found.effects
    assert (named.cause.effect, named.cause.form) == ("screw_wear", "at_600_mm")
    assert named.story == plugin.story
    for parameter in named.parameters:
        true = WEAR_MM[parameter.parameter.name]
        assert abs(parameter.value - true) <= 4.0 * parameter.std <= 0.2
    assert found.held_out.closed > 0.9


def test_the_amended_model_holds_it_and_no_gap_is_left(found, worn, tmp_path):
    """Saved, loaded and diagnosed again: the stack applies the effect, and no gap remains."""
    model = RobotModel.load(amended(found).save(tmp_path / "worn.yaml"))
    assert [(entry.effect, entry.form, entry.placed) for entry in model.effects] == [("screw_wear", "at_600_mm", False)]
    assert diagnose(worn, model).judgement.verdict == "no_gap"


def test_without_it_the_cause_is_unknown(plugin, worn):
    found = diagnose(worn, options=DiagnosisOptions(exclude=(plugin.id,)))
    assert found.judgement.verdict == "unknown"
