"""Many poses at once give the same as one by one; results are shown in one line."""

import dataclasses

import numpy as np
import pandas as pd
import pytest
import xarray as xr

import pouring_robot
from pouring_robot import BadInputError, Loads, PlatformPose, PouringRobot, package_path, urdf_path
from pouring_robot.mechanism.transfer import closed_chain_transfer
from tests.support import ACTUAL, random_poses

FAR = PlatformPose((0.0, 0.0, -3.0), 0.0)


@pytest.fixture(scope="module")
def loaded(as_built):
    return PouringRobot(as_built.model, Loads(gravity=True, payload_kg=300.0, payload_frame="ladle"))


@pytest.mark.parametrize("name", ["as_built", "very_crooked", "loaded"])
def test_many_poses_equal_one_by_one(request, name):
    robot = request.getfixturevalue(name)
    poses = [*random_poses(6, seed=3), FAR]
    many = robot.locate(poses)
    assert dict(many.sizes) == {"pose": 7, "frame": 3, "axis": 3}
    assert many.status.values.tolist() == ["closed"] * 6 + ["out of reach"]
    assert np.isnan(many.error_position.values[-1]).all()
    for k, pose in enumerate(poses[:-1]):
        location = robot.locate(pose)
        for frame in location.loops.reported_frames:
            nominal, actual = location.poses(frame)
            off = location.difference(frame)
            found = many.sel(frame=frame).isel(pose=k)
            assert found.nominal_position.values == pytest.approx(nominal.translation, abs=1e-9)
            assert found.actual_position.values == pytest.approx(actual.translation, abs=1e-9)
            assert found.error_position.values == pytest.approx(off.translation_m, abs=1e-9)
            assert found.error_rotation.values == pytest.approx(off.rotation_rad, abs=1e-9)
    assert many.error_position.attrs["units"] == "m"


def test_an_array_of_poses_is_the_same_as_a_list(as_built):
    poses = random_poses(3, seed=4)
    array = np.array([[*pose.position_m, pose.tilt_rad] for pose in poses])
    xr.testing.assert_identical(as_built.locate(array), as_built.locate(poses))
    assert as_built.locate([]).sizes["pose"] == 0


_TABLE = pd.DataFrame({"x_m": [-0.1], "y_m": [0.0], "z_m": [-0.6], "tilt_deg": [1.0]})
_MASKED = np.ma.array([[-0.1, 0.0, -0.6, 0.0]], mask=[[0, 1, 0, 0]])
_NO_POSES = [[1.0, 2.0], np.zeros((2, 3)), np.empty((0, 3)), [[0.0], [1.0, 2.0]], [[0.0, 0.0, np.nan, 0.0]], None]


@pytest.mark.parametrize("poses", [*_NO_POSES, _TABLE, _MASKED])
def test_other_arguments_than_a_list_of_poses_are_refused(as_built, poses):
    with pytest.raises(BadInputError, match="shape"):
        as_built.locate(poses)


def test_the_transfer_matrix_carries_its_labels(as_built):
    (pose,) = random_poses(1, seed=5)
    labelled = as_built.transfer(pose, ["drives", "leg1_s2.rz"])
    assert labelled.parameter.values.tolist()[-1] == "leg1_s2.rz"
    assert labelled.per.values.tolist() == ["m", "m", "m", "rad", "rad"]
    assert labelled.unit.sel(component="ry").item() == "rad"
    local = [as_built.parameters.match("leg1_s2.rz")[0].local]
    same = closed_chain_transfer(as_built.actual_solver, as_built.locate(pose).actual, local, "ladle_lip")
    np.testing.assert_allclose(labelled.sel(parameter="leg1_s2.rz"), same.matrix[:, 0], rtol=1e-7)
    assert as_built.transfer(pose).sizes["parameter"] > 30


def test_results_are_shown_in_one_line(as_built):
    (pose,) = random_poses(1, seed=6)
    location = as_built.locate(pose)
    matrix = closed_chain_transfer(as_built.actual_solver, location.actual, [as_built.parameters.drives[0]])
    for result in (location, location.actual, matrix):
        assert "\n" not in repr(result)
        assert len(repr(result)) < 200
        assert "<table" in result._repr_html_()
    frame = location.to_frame()
    assert frame.frame.tolist() == list(location.loops.reported_frames)
    shift, _ = location.difference("ladle_lip").to_mm_mrad()
    assert frame.iloc[-1][["error_x_mm", "error_y_mm", "error_z_mm"]].tolist() == pytest.approx(shift.tolist())
    assert dataclasses.fields(location)


def test_files_for_other_programs():
    assert (package_path() / "meshes").is_dir()
    drawing, built = urdf_path(layout="wide"), urdf_path(model=ACTUAL)
    assert drawing.read_text(encoding="utf-8") != built.read_text(encoding="utf-8")
    assert (built.parent / "meshes").is_dir()
    assert urdf_path(model=ACTUAL) == built
    with pytest.raises(BadInputError, match="not both"):
        urdf_path(layout="wide", model=ACTUAL)


def test_every_name_of_the_root_exists():
    assert all(getattr(pouring_robot, name) is not None for name in pouring_robot.__all__)


def test_the_types_of_options_exist_too():
    """A reader who learned that noise is a NoiseLevel had to search for it."""
    p = pouring_robot
    assert p.CalibrationOptions(fit=p.FitOptions(loss="linear"), tolerances=p.Tolerances.load()).fit.loss == "linear"
    assert p.PlanRequest(noise=p.NoiseLevel.stated(1e-5, 2e-5)).noise.position_m == 1e-5
    assert "melt_degC=1650.0" in repr(p.HeatedRobot(p.PouringRobot(), p.HeatSection(melt_degC=1650)))
