"""A campaign as a problem for the search: signatures of all effects at the present state of the robot."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from pouring_robot.diagnosis.processes import poses
from pouring_robot.diagnosis.rows import CampaignRows, LinearRows
from pouring_robot.effects.base import Effect, EffectParameter, Form, checked_forms
from pouring_robot.effects.registry import all_effects
from pouring_robot.inference.explanations import WORKMANSHIP_FORM, Explanation, Workmanship
from pouring_robot.mechanism.arrays import FloatArray

SAG = "background_sag"
_SAG_COLUMNS, _SAG_SIZE = 40, 1.0 / 32.0
"""So many directions carry nearly all of it; at 5 kN it is at most what axes that are off by a 32nd of a mrad do."""


@dataclass(frozen=True, eq=False)
class Library:
    """What a campaign can be searched for."""

    effects: Mapping[str, Effect]  # all there are, by id
    # of the effects that may be named and that the campaign can test, by effect and form
    forms: Mapping[tuple[str, str], Form]
    workmanship: Mapping[str, Form]  # its kinds, by the effect that each is called when it is all there is

    @classmethod
    def of(cls, rows: CampaignRows, chosen: Mapping[str, Effect]) -> Library:
        """Return the library for a campaign, of effects that may be named, by id.

        Raises:
            BadInputError: an effect of a package does not do as :class:`~pouring_robot.effects.base.Effect` says.
        """
        given, channels = rows.conditions, rows.channels
        forms = {
            (effect.id, form.name): form
            for effect in chosen.values()
            if not effect.missing(given)
            for form in checked_forms(effect, given, channels)
        }
        effects = all_effects(given.robot)
        kinds = {name: effect.workmanship(given) for name, effect in effects.items()}
        return cls(effects, forms, {name: Form(WORKMANSHIP_FORM, found) for name, found in kinds.items() if found})

    @property
    def every_form(self) -> dict[tuple[str, str], Form]:
        """Workmanship and forms of effects, by effect and form."""
        return {(effect, form.name): form for effect, form in self.workmanship.items()} | dict(self.forms)

    @property
    def tried(self) -> frozenset[str]:
        """Ids of the effects of which there is a form."""
        return frozenset(effect for effect, _ in self.forms)


def workmanship_of(rows: CampaignRows, linear: LinearRows, library: Library) -> Iterator[Workmanship]:
    """Yield the kinds of workmanship with their columns in all equations."""
    for effect, form in library.workmanship.items():
        yield Workmanship(effect, rows.columns(form, linear))


def known_effects(rows: CampaignRows, linear: LinearRows, library: Library) -> Iterator[Explanation]:
    """Yield what may be found, and what weight makes of workmanship, with their columns in all equations."""
    # What weight makes comes first: it takes most room while it is made, and the others are not there yet.
    loose = [form for name, form in library.workmanship.items() if library.effects[name].loosened_by_load]
    if loose and rows.conditions.weight_n is not None:
        yield _sag(rows, linear, np.hstack([rows.columns(form, linear) for form in loose]), rows.conditions.weight_n)
        yield _softness(rows, linear)
    for (effect, _), form in library.forms.items():
        main = np.array([p.main for p in form.parameters])
        yield Explanation(effect, form.name, rows.columns(form, linear), main, one_of=form.one_of)


def _softness(rows: CampaignRows, linear: LinearRows) -> Explanation:
    """Return what weight makes of joints that turn where they should not, all alike.

    The unit is the stiffness that the loops are taken to have: as it is assumed, the joints' own is found.
    """
    _, stiffness = rows.conditions.robot.mechanism().loops.stiffness_si
    turned = {name: moment / stiffness for name, moment in rows.conditions.joint_moments.items()}
    column = rows.column(EffectParameter("softness", "rad/rad", 1.0, turned), linear)
    return Explanation(SAG, "soft_joints", column[:, None], np.ones(1, dtype=bool), cause=False)


def _sag(rows: CampaignRows, linear: LinearRows, axes: FloatArray, weight_n: FloatArray) -> Explanation:
    """Return what weight makes of tilted axes: the end body gives way, where the mechanism is soft.

    Closed chains may hold it in some directions by the stiffness of their joints alone, so that under load a tilt of an
    axis moves it further, by load and pose. What stiffness there is nobody knows; hence no cause but an explanation.
    """
    poses_and_one = np.column_stack([np.ones(len(rows)), poses(rows.conditions)])
    load = ((weight_n - weight_n.mean()) / 5000.0)[:, None] * poses_and_one
    # Load by load: side by side they would be the largest thing that a diagnosis holds.
    factors = [factor[linear.row][:, None] for factor in load.T]
    products = [[axes.T @ (axes * (one * other)) for other in factors] for one in factors]
    _, directions = np.linalg.eigh(np.block(products))
    kept = np.split(_SAG_SIZE * directions[:, ::-1][:, :_SAG_COLUMNS], len(factors))
    columns = np.zeros((len(axes), kept[0].shape[1]))
    for factor, shares in zip(factors, kept, strict=True):
        columns += factor * (axes @ shares)
    return Explanation(SAG, "soft_sideways", columns, np.ones(columns.shape[1], dtype=bool), cause=False, largest=1.0)
