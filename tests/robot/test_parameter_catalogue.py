"""The catalogue: every name is found, none occurs twice, and for a misspelt one the nearest is suggested."""

import pytest

from pouring_robot.exceptions import BadInputError
from pouring_robot.robot.model import RobotModel
from pouring_robot.robot.parameter_catalogue import all_parameters
from pouring_robot.robot.pouring.names import CHAIN_JOINTS, DRIVE_JOINTS, INNER_JOINTS, SEATS, SETS
from pouring_robot.robot.tolerances import kind_of


@pytest.fixture(scope="module")
def catalogue(drawing):
    return drawing.parameters


@pytest.mark.parametrize("name", SETS)
def test_sets_hold_each_parameter_once(catalogue, name):
    names = [p.name for p in all_parameters(catalogue.groups((name,)))]
    assert len(names) == len(set(names)) > 10


def test_sizes(catalogue):
    assert len(all_parameters(catalogue.groups())) == 88
    # 4 drives and 96 DH parameters: 128 less those dropped by design, less the joint variables that drives cover.
    assert len(all_parameters(catalogue.groups(("dh",)))) == 100


def test_a_parameter_belongs_to_the_first_group_that_names_it(catalogue):
    groups = catalogue.groups(("leg1_s1.tx", "fixed_centres", "centres"))
    assert [group.name for group in groups] == ["leg1_s1.tx", "fixed_centres", "drives", "moving_centres"]
    assert len(groups[1].parameters) == 11


@pytest.mark.parametrize(("name", "words"), [("geometri", "geometry"), ("leg9_s1.tx", "leg"), ("?!", "give a set")])
def test_unknown_names_are_refused_with_a_hint(catalogue, name, words):
    with pytest.raises(BadInputError, match=f"no parameter is called .*{words}"):
        catalogue.groups((name,))
    with pytest.raises(BadInputError, match="name the parameters"):
        catalogue.groups(())


def test_a_set_is_found_like_a_name(catalogue):
    found = [p.name for p in catalogue.match("centres")]
    assert found == [p.name for p in all_parameters(catalogue.groups(("centres",)))]
    kinds = {kind_of(p.local, INNER_JOINTS) for p in catalogue.match("centres")}
    assert kinds == {"linear_drive_offset", "rotary_drive_offset", "joint_centre"}
    assert kind_of(catalogue.match("alpha_e1_56")[0].local, INNER_JOINTS) == "joint_axis"


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("d_e1_4", "it is drive.leg1_s3"),
        ("theta_e2_3", "passive joint 'leg2_s2' compensates for it"),
        ("d_e1_0", "origin"),
    ],
)
def test_parameters_that_measurements_cannot_show_are_refused_with_the_reason(catalogue, name, reason):
    assert catalogue.match(name)[0].hidden_by
    with pytest.raises(BadInputError, match=f"'{name}' cannot be identified: .*{reason}"):
        catalogue.groups((name,))


def test_names_are_those_of_the_description(catalogue):
    mechanism = RobotModel().definition.mechanism()
    assert mechanism.loops.drives == DRIVE_JOINTS
    chains = [joints for chain, seat in zip(CHAIN_JOINTS, SEATS, strict=True) for joints in (*chain, seat)]
    assert list(catalogue.table.joints) == chains
