"""The measurement model against the one-at-a-time solver, its Jacobian against differences."""

import numpy as np
import pinocchio as pin
import pytest

from pouring_robot.batch import engine_for
from pouring_robot.estimation.changes import SCALE, RowChanges
from pouring_robot.estimation.frames.outer import FRAMES
from pouring_robot.estimation.measurement import Unknowns
from pouring_robot.exceptions import BadInputError, UnknownJointError
from pouring_robot.mechanism.closed_chain import ClosedChainMechanism
from pouring_robot.mechanism.local_parameters import DriveParameter, PayloadParameter, PlacementParameter
from pouring_robot.robot.model import DriveOffset, RobotModel
from tests.estimation.virtual import INNER, OUTER, TRUE_FRAMES, Virtual, measured_poses, model_of, reference_poses
from tests.support import arm, arm_urdf, crooked_model


@pytest.fixture(params=["drawing", "crooked"])
def present(request):
    return RobotModel() if request.param == "drawing" else crooked_model(seed=3, axis_mrad=1.5)


def test_predictions_are_those_of_the_one_at_a_time_solver(drawing, present):
    model = model_of(drawing, "geometry", model=present)
    virtual = Virtual(drawing, model, 8, seed=2)
    values = virtual.unknowns.values.copy()
    values[:FRAMES] = np.random.default_rng(4).normal(size=FRAMES) * 0.02
    unknowns = virtual.unknowns.at(values)
    drives = virtual.rows.drives
    configurations = [
        drawing.kinematics.configuration(
            drawing.kinematics.forward(dict(zip(present.definition.loops.drives, map(float, row), strict=True)))
        )
        for row in drives
    ]
    poses = reference_poses(present, model.parameters, virtual.truth, drives, configurations)
    outer = OUTER * pin.SE3(pin.exp3(values[3:6]), values[:3])
    inner = pin.SE3(pin.exp3(values[9:12]), values[6:9]) * INNER
    expected = measured_poses(poses, outer, inner)
    seen = virtual.rows.predict(unknowns)
    assert seen.closed.all()
    np.testing.assert_allclose(seen.position_m, expected[:, :3, 3], atol=1e-9)
    np.testing.assert_allclose(seen.rotation, expected[:, :3, :3], atol=1e-9)


@pytest.mark.parametrize("changed", [False, True], ids=["alike", "row by row"])
def test_jacobian_is_the_derivative(drawing, present, changed):
    model = model_of(drawing, "all", model=present)
    virtual = Virtual(drawing, model, 6, seed=5)
    if changed:
        random, structure = np.random.default_rng(7), model.engine.structure
        exact = ("drive.leg1_s3", "leg1_s1.ty", "base.tx", "base.rz", SCALE)
        moved = {name: random.normal(size=6) * 1e-2 for name in exact}
        # The effect of a row's own rotation of a joint on the axes of parameters there is neglected: below 2e-6.
        moved["leg1_s1.rx"] = random.normal(size=6) * 1e-7
        virtual.rows = virtual.rows.with_changes(RowChanges.of(moved, structure, 6))
    values = virtual.unknowns.values.copy()
    values[:FRAMES] = np.random.default_rng(6).normal(size=FRAMES) * 0.05
    seen = virtual.rows.linearise(virtual.unknowns.at(values))
    step = 1e-6
    for k in range(len(values)):
        aside = np.zeros_like(values)
        aside[k] = step
        plus, minus = (virtual.rows.predict(virtual.unknowns.at(values + s * aside)) for s in (1.0, -1.0))
        turned = plus.rotation @ np.swapaxes(minus.rotation, 1, 2)
        difference = np.concatenate(
            [plus.position_m - minus.position_m, np.array([pin.log3(r) for r in turned])], axis=1
        )
        # The error of differences is the tolerance of closures over the step, plus the step squared: well below 2e-6.
        np.testing.assert_allclose(seen.jacobian[:, :, k], difference / (2.0 * step), rtol=2e-6, atol=2e-6)


def test_drive_offsets_of_the_model_are_added_to_the_command(drawing):
    offsets = {"leg1_s3": DriveOffset(offset_mm=0.7), "leg4_s5": DriveOffset(offset_mrad=-2.0)}
    model = model_of(drawing, "drives", model=RobotModel(drive_offsets=offsets))
    virtual = Virtual(drawing, model_of(drawing, "drives"), 5)
    zero = Unknowns.zero(TRUE_FRAMES, 4)
    with_offsets = model.at(virtual.rows.drives).predict(zero)
    same = virtual.rows.predict(zero.at(np.r_[np.zeros(FRAMES), 0.7e-3, 0.0, 0.0, -2e-3]))
    np.testing.assert_allclose(with_offsets.position_m, same.position_m, atol=1e-12)


def test_drive_values_without_a_pose_give_a_status_not_a_number(drawing):
    model = model_of(drawing, "drives")
    virtual = Virtual(drawing, model, 4)
    drives = virtual.rows.drives.copy()
    drives[1, 0], drives[2] = 5.0, np.nan
    seen = model.at(drives).linearise(virtual.unknowns)
    assert seen.closed.tolist() == [True, False, False, True]
    for array in (seen.position_m, seen.rotation, seen.jacobian):
        finite = np.isfinite(array).reshape(4, -1)
        assert finite[[0, 3]].all()
        assert not finite[[1, 2]].any()


def test_rows_can_be_chosen(drawing):
    virtual = Virtual(drawing, model_of(drawing, "drives"), 6)
    whole = virtual.rows.predict(virtual.unknowns).position_m
    for rows in (np.array([4, 1]), np.arange(6) % 2 == 0):
        np.testing.assert_array_equal(virtual.rows[rows].predict(virtual.unknowns).position_m, whole[rows])


@pytest.mark.parametrize("name", ["drive", "metrology", "leg.2"])
def test_changes_in_a_joint_are_found_whatever_the_joint_is_called(name):
    mechanism = ClosedChainMechanism(
        arm_urdf().replace('joint name="elbow"', f'joint name="{name}"'),
        arm().loops.model_copy(update={"drives": ("waist", "shoulder", name, "roll", "pitch", "flange_turn")}),
    )
    structure = engine_for(mechanism).structure
    change = np.array([1e-3, 2e-3])
    found = RowChanges.of({f"drive.{name}": change, f"{name}.tx": 2 * change}, structure, 2)
    np.testing.assert_array_equal(found.drives[:, 2], change)
    np.testing.assert_array_equal(found.placements[:, 6 * structure.site(name)], 2 * change)
    assert np.count_nonzero(found.drives) + np.count_nonzero(found.placements) == 4


def test_wrong_parameters_and_shapes_are_refused(drawing):
    model = model_of(drawing, "drives")
    twist = (1.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    with pytest.raises(BadInputError, match="is given twice"):
        model.with_parameters([DriveParameter("leg1_s3", "m")] * 2)
    with pytest.raises(BadInputError, match=r"'tool\.tx' is given twice; the joint is called as an outer frame is"):
        model.with_parameters([PlacementParameter("tool.tx", "m", "leg1_s1", twist)])
    with pytest.raises(UnknownJointError):
        model.with_parameters([PlacementParameter("x", "m", "leg9_s1", twist)])
    with pytest.raises(BadInputError, match="no placement or drive parameter"):
        model.with_parameters([PayloadParameter()])
    with pytest.raises(BadInputError, match="no placement or drive parameter"):
        model.with_parameters([DriveParameter("leg4_s3", "m")])
    with pytest.raises(BadInputError, match="shape"):
        model.at(np.zeros((3, 3)))
    rows = Virtual(drawing, model, 4).rows
    with pytest.raises(BadInputError, match="finite values"):
        rows.predict(Unknowns.zero(TRUE_FRAMES, 3))
    with pytest.raises(BadInputError, match="finite values"):
        rows.predict(Unknowns.zero(TRUE_FRAMES, 4).at(np.full(16, np.nan)))
