"""Parameter sets: every name is found, none stands twice, and misspelt ones are met with the nearest."""

import pytest

from pouring_robot.exceptions import BadInputError
from pouring_robot.robot.parameters import SETS, all_parameters


@pytest.fixture(scope="module")
def catalogue(drawing):
    return drawing.parameters


@pytest.mark.parametrize("name", SETS)
def test_sets_hold_each_parameter_once(catalogue, name):
    names = [p.name for p in all_parameters(catalogue.groups((name,)))]
    assert len(names) == len(set(names)) > 10


def test_sizes(catalogue):
    assert len(all_parameters(catalogue.groups())) == 88
    # 4 drives and 96 DH parameters: 128 less what the design drops out, less the joint variables that drives cover.
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
