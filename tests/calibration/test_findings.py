"""What changed: values, intervals and verdicts, and the effect of a group at the ladle."""

import dataclasses

import numpy as np
import pytest

from pouring_robot.calibration.calibrate import CalibrationOptions, calibrate
from pouring_robot.calibration.findings import ParameterLine, combination_lines, group_effects, parameter_lines
from pouring_robot.estimation.frames.outer import FRAMES
from tests.campaign.simulated import SIGMA_M


def test_parameters_come_in_the_units_of_the_shop_floor(found):
    lines = parameter_lines(found)
    assert [line.name for line in lines] == list(found.base.names[FRAMES:])
    for k, line in enumerate(lines, start=FRAMES):
        assert line.unit == ("mm" if found.unknown_units[k] == "m" else "mrad")
        assert line.value == pytest.approx(1e3 * found.fit.unknowns.values[k])
        assert line.std == pytest.approx(1e3 * found.std[k])
        assert line.dof == found.ladle.dof == found.noise.dof < 1e3


def test_verdicts():
    line = ParameterLine("x", "mm", 1.0, 0.1, 1.0, "g", True)
    assert line.verdict == "moved"
    assert line.interval == pytest.approx((0.804, 1.196), abs=1e-3)
    assert ParameterLine("x", "mm", 0.1, 0.1, 1.0, "g", True).verdict == "not shown to be off"
    assert ParameterLine("x", "mm", 1.0, 0.9, 1.0, "g", True).verdict == "held by its tolerance"


def test_combinations_hold_no_frame_and_are_better_known_than_their_parts(found):
    lines = combination_lines(found)
    assert lines[0].moved
    assert all("base." not in line.name and "tool." not in line.name for line in lines)
    surest = [abs(line.value) / line.std for line in lines]
    assert surest == sorted(surest, reverse=True)
    assert all(line.std < line.prior_std for line in lines)


def test_the_effect_of_a_group_is_what_its_absence_costs(found):
    """Against predictions with the group's values removed and the frames refitted by hand."""
    effects = {line.name: line for line in group_effects(found)}
    assert set(effects) == {group.name for group in found.selection.groups}
    fit, first = found.fit, FRAMES
    for group in found.selection.groups:
        columns = np.arange(first, first + len(group.parameters))
        first += len(group.parameters)
        effect = fit.equations.jacobian[:, columns] @ fit.unknowns.values[columns]
        frames = fit.equations.jacobian[:, :FRAMES]
        left = effect - frames @ (np.linalg.pinv(frames, rcond=1e-10) @ effect)
        position = left[fit.equations.components < 3] * found.noise.position_m * 1e3
        assert effects[group.name].moved_mm == pytest.approx(np.sqrt((position**2).mean()), rel=1e-6)
        assert effects[group.name].moved_mm > 0.01


def test_the_effect_of_a_group_is_given_at_positions_where_distances_were_measured_too(clean):
    """Distances are known forty times better than positions: each equation is over its own noise."""
    campaign, options = clean.campaign, CalibrationOptions(parameters=("drives",), choose=False)
    known = campaign.metadata.model_copy(update={"sigma_distance_m": SIGMA_M / 40.0})
    lengths = np.linalg.norm(campaign.position_m, axis=1, keepdims=True)
    found = calibrate(dataclasses.replace(campaign, distance_m=lengths, metadata=known), None, options)
    equations = found.fit.equations
    frames, own = equations.jacobian[:, :FRAMES], equations.jacobian[:, FRAMES:]
    effect = own @ found.fit.unknowns.values[FRAMES:]
    left = effect - frames @ (np.linalg.pinv(frames, rcond=1e-10) @ effect)
    places = left[equations.components < 3] * SIGMA_M * 1e3
    (line,) = group_effects(found)
    assert line.moved_mm == pytest.approx(np.sqrt((places**2).mean()), rel=1e-6)


def test_the_effect_of_a_group_excludes_what_frames_of_sessions_absorb(found):
    """Their columns follow those of the parameters: here they equal the columns of all groups."""
    jacobian = found.fit.equations.derivatives
    equations = dataclasses.replace(found.fit.equations, jacobian=np.hstack([jacobian, jacobian[:, FRAMES:]]))
    beside = dataclasses.replace(found, fit=dataclasses.replace(found.fit, equations=equations))
    for line, alone in zip(group_effects(beside), group_effects(found), strict=True):
        assert alone.moved_mm > 1e-3
        assert line.moved_mm < 1e-9
