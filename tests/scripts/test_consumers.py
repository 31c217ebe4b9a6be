"""The table of other programs, for those that this environment has; the whole table stands in docs/export.md."""

import pytest

from scripts.studies.consumers import check, main

HERE = (
    "Pinocchio",
    "Pinocchio RobotWrapper, `--absolute-meshes`",
    "yourdfpy",
    "check_urdf",
    "MuJoCo, MJCF",
    "MuJoCo, URDF",
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The exported robot in all formats."""
    place = tmp_path_factory.mktemp("consumers")
    main(["write", str(place)])
    return place


@pytest.mark.parametrize("name", HERE)
def test_a_program_loads_all_of_the_closed_robot(name, folder):
    ((_, _, _, shown, mass, lip),) = check(folder, [name])
    if name != "check_urdf":  # which only reads
        assert shown == "160 of 160"
        assert abs(float(mass.split()[0])) < 1e-9
        assert float(lip) < 1e-9
