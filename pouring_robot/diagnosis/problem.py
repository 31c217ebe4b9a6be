"""A campaign as a problem for the search: signatures of all effects at the present state of the robot."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from pouring_robot.diagnosis.descriptions import poses
from pouring_robot.diagnosis.rows import CampaignRows, LinearRows
from pouring_robot.effects.base import Effect, Form, checked_forms
from pouring_robot.effects.joints import axis_parameters, centre_parameters
from pouring_robot.inference.explanations import Background, Explanation, Problem
from pouring_robot.mechanism.arrays import FloatArray

BACKGROUND_CENTRES_MM, BACKGROUND_AXES_MRAD = 0.015, 0.012
"""Usual small errors that workmanship leaves after adjustment: U-joint centres and axes."""
SMALL = {"joint_centre_offset": 0.035, "joint_axis_tilt": 0.08, "leg_compliance": 0.02}
"""Up to which size (mm, mrad, mm at 5 kN) an effect is what every machine has: not named beside another cause."""
SAG = "background_sag"
_SAG_COLUMNS, _SAG_SIZE, _SAG_LARGEST = 40, 0.3, 4.0


def background_forms(rows: CampaignRows) -> dict[str, Form]:
    """Return the usual small geometric errors, by the effect they are called when they are all there is."""
    one = np.ones(len(rows))
    centres = [p for found in centre_parameters(one, BACKGROUND_CENTRES_MM).values() for p in found]
    axes = [p for found in axis_parameters(one, BACKGROUND_AXES_MRAD).values() for p in found]
    return {
        "joint_centre_offset": Form("background", tuple(centres)),
        "joint_axis_tilt": Form("background", tuple(axes)),
    }


def effect_forms(rows: CampaignRows, effects: Mapping[str, Effect]) -> dict[tuple[str, str], Form]:
    """Return every form of every effect that this campaign can test.

    Raises:
        BadInputError: an effect that a package offers does not do as :class:`~pouring_robot.effects.base.Effect` says.
    """
    channels = rows.channels
    return {
        (effect.id, form.name): form
        for effect in effects.values()
        if not effect.missing(rows.conditions)
        for form in checked_forms(effect, rows.conditions, channels)
    }


def problem_at(
    rows: CampaignRows,
    linear: LinearRows,
    forms: Mapping[tuple[str, str], Form],
    backgrounds: Mapping[str, Form],
    added: FloatArray,
) -> Problem:
    """Return the problem linearised at a state.

    Args:
        rows: the campaign.
        linear: residuals and derivatives there.
        forms: of the effects, by effect and form.
        backgrounds: usual small errors, by effect.
        added: what the state's own changes add to the prediction to first order, (m,): it is given back, so that the
            problem is to find them again.
    """
    usual = tuple(Background(effect, rows.columns(form, linear)) for effect, form in backgrounds.items())
    found = [
        Explanation(
            effect,
            form.name,
            rows.columns(form, linear),
            np.array([p.main for p in form.parameters]),
            small=SMALL.get(effect, 0.0),
        )
        for (effect, _), form in forms.items()
    ]
    sag = _sag(rows, linear, usual)
    return Problem.build(linear.residual + added, linear.free, usual, (*found, *sag))


def _sag(rows: CampaignRows, linear: LinearRows, usual: tuple[Background, ...]) -> list[Explanation]:
    """Return what weight makes of tilted axes: the platform gives way sideways, where the mechanism is soft.

    The four chains hold the platform against Y and roll by their rotational stiffness alone, so that under load a tilt
    of an axis moves it further, by load and pose. What stiffness there is nobody knows; hence no cause but an
    explanation.
    """
    given = rows.conditions
    if given.weight_n is None:
        return []
    axes = next(b.columns for b in usual if b.effect == "joint_axis_tilt")
    load = ((given.weight_n - given.weight_n.mean()) / 5000.0)[:, None] * np.column_stack(
        [np.ones(len(rows)), poses(given)]
    )
    stacked = np.hstack([axes * factor[linear.row][:, None] for factor in load.T])
    _, directions = np.linalg.eigh(stacked.T @ stacked)
    columns = _SAG_SIZE * stacked @ directions[:, ::-1][:, :_SAG_COLUMNS]
    return [
        Explanation(
            SAG, "soft_sideways", columns, np.ones(columns.shape[1], dtype=bool), cause=False, largest=_SAG_LARGEST
        )
    ]
