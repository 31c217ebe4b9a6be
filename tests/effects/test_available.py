"""Which effects there are: the contract's fourteen, those of installed packages, and packages that are broken."""

import zlib

import pytest

from pouring_robot.effects import Effect, all_effects, available, chosen_effects
from pouring_robot.exceptions import BadInputError
from pouring_robot.robot.model import RobotModel
from pouring_robot.robot.pouring_robot import PouringRobot
from tests.effects.plugins import installed

CONTRACT = (
    *("drive_zero_offset", "drive_scale", "drive_cyclic", "drive_backlash", "joint_centre_offset"),
    *("joint_axis_tilt", "leg_thermal_expansion", "platform_thermal_expansion", "leg_compliance"),
    *("tilt_drive_compliance", "truss_deflection", "base_drift", "tilt_encoder_eccentricity", "metrology_scale"),
)
"""The ids are a contract: written a second time on purpose."""
MODULE = """
from pouring_robot.effects import Effect


class Good(Effect):
    id = "loose_bolt"
    story = "a bolt is loose"

    def forms(self, conditions):
        return ()


class Twin(Good):
    id = "drive_scale"


class Unfinished(Effect):
    id = "unfinished"


class Astray(Good):
    driven_by = "lengths"


class Needy(Good):
    needs = ("payload_kg",)


class Shaped(Good):
    shaped_by = ("weigth_n",)


class Lone(Good):
    robots = "arm"


class Bare(Good):
    needs = ("weight_n")


class BareShape(Good):
    shaped_by = "weight_n"


class Nameless(Effect):
    def forms(self, conditions):
        return ()


class Broken(Good):
    def __init__(self):
        raise RuntimeError("the table of\\nbolts is empty")


def no_effect():
    return 42
"""


class Entry:
    """What importlib.metadata gives for an entry point."""

    def __init__(self, name, kind):
        self.name, self.value, self._kind = name, f"somewhere:{name}", kind

    def load(self):
        if isinstance(self._kind, Exception):
            raise self._kind
        return self._kind


class LooseBolt(Effect):
    id = "loose_bolt"
    story = "a bolt is loose"

    def forms(self, conditions):
        return ()


def offering(monkeypatch, *entries):
    """Let packages offer these entry points."""
    monkeypatch.setattr(available, "entry_points", lambda group: {available.GROUP: entries}[group])


def test_the_library_is_the_contract():
    assert tuple(effect.id for effect in available.library(RobotModel().definition)) == CONTRACT
    assert tuple(all_effects())[:14] == CONTRACT


def test_effects_of_packages_come_after_the_library(monkeypatch):
    offering(monkeypatch, Entry("bolt", LooseBolt))
    found = all_effects()
    assert tuple(found) == (*CONTRACT, "loose_bolt")
    assert isinstance(found["loose_bolt"], LooseBolt)


def test_entry_points_are_those_of_the_interpreter(monkeypatch):
    """The group is part of the contract with other packages."""
    import importlib.metadata

    assert available.entry_points is importlib.metadata.entry_points
    assert available.GROUP == "pouring_robot.effects"


@pytest.fixture
def package(tmp_path, monkeypatch):
    """Return a function that puts on Python's path a package that offers one object of MODULE."""

    def offer(value, module=MODULE):
        name = f"bolts_{zlib.crc32((value + module).encode())}"
        monkeypatch.syspath_prepend(str(installed(tmp_path / name, name, module, {"mine": f"{name}:{value}"})))
        return f"{name}:{value}"

    return offer


def test_a_package_on_the_path_is_found(package):
    package("Good")
    assert all_effects()["loose_bolt"].story == "a bolt is loose"


@pytest.mark.parametrize(
    ("value", "module", "said"),
    [
        ("Absent", MODULE, "cannot be loaded"),
        ("Good", "import a_package_nobody_has", "cannot be loaded: No module named 'a_package_nobody_has'"),
        ("Good", "class Good(", "cannot be loaded"),
        ("Unfinished", MODULE, "cannot be loaded"),
        ("Broken", MODULE, "cannot be loaded: the table of bolts is empty"),
        ("no_effect", MODULE, "is not a subclass of Effect"),
        ("Nameless", MODULE, "has no id"),
        ("Astray", MODULE, "driven by 'lengths', which is not a condition; did you mean 'lengths_m'?"),
        ("Needy", MODULE, "needs 'payload_kg', which is not a condition"),
        ("Needy", MODULE, "if it is not for the robot 'pouring_robot', list the robots it is for in its `robots`"),
        ("Shaped", MODULE, "is shaped by 'weigth_n', which is not a condition; did you mean 'weight_n'?"),
        ("Lone", MODULE, "write robots = ('arm',)"),
        ("Bare", MODULE, "write needs = ('weight_n',)"),
        ("BareShape", MODULE, "write shaped_by = ('weight_n',)"),
        ("Twin", MODULE, "two effects are called 'drive_scale'; rename"),
    ],
)
def test_broken_package_is_named_on_one_line(package, value, module, said):
    where = package(value, module)
    with pytest.raises(BadInputError) as problem:
        all_effects()
    line = str(problem.value)
    assert said in line
    assert where in line
    assert "\n" not in line
    assert problem.value.exit_code == 2


def test_two_packages_with_the_same_effect(monkeypatch):
    offering(monkeypatch, Entry("first", LooseBolt), Entry("second", LooseBolt))
    with pytest.raises(BadInputError, match="two effects are called 'loose_bolt'; rename the one of somewhere:second"):
        all_effects()


def test_leaving_effects_out():
    assert tuple(chosen_effects(exclude=("drive_scale", "base_drift", "drive_scale"))) == tuple(
        name for name in CONTRACT if name not in {"drive_scale", "base_drift"}
    )
    assert not chosen_effects(exclude=CONTRACT)


def test_leaving_out_what_a_package_offers(monkeypatch):
    offering(monkeypatch, Entry("bolt", LooseBolt))
    assert tuple(chosen_effects(exclude=("loose_bolt",))) == CONTRACT


def test_unknown_effect_to_leave_out():
    with pytest.raises(BadInputError, match=r"no effect 'drive_scales'; did you mean 'drive_scale'\?"):
        chosen_effects(exclude=("drive_scales",))
    for given in (None, 3, [3]):
        with pytest.raises(BadInputError, match="an effect is excluded by its name, not a "):
            chosen_effects(exclude=given)


def test_an_effect_may_need_a_quantity_computed_from_the_rows(monkeypatch):
    class Leaning(LooseBolt):
        needs = ("tilt_rad", "position_m")

    offering(monkeypatch, Entry("bolt", Leaning))
    assert isinstance(all_effects()["loose_bolt"], Leaning)


def test_a_robot_may_be_given_in_any_way_and_one_effect_by_its_name():
    assert list(all_effects(PouringRobot())) == list(all_effects())
    assert "drive_scale" not in chosen_effects(None, "drive_scale")
