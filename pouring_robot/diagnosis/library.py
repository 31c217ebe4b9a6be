"""A campaign as a problem for the search: signatures of all effects at the current state of the robot."""

import math
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Self

import numpy as np

from pouring_robot.diagnosis.rows import CampaignRows, LinearRows, Signatures
from pouring_robot.effects.available import all_effects
from pouring_robot.effects.base import Effect, EffectParameter, Form, checked_forms
from pouring_robot.inference.problem import WORKMANSHIP_FORM, Explanation, Workmanship

SOFTNESS = "background_softness"  # fitted but not an effect: see :func:`_softness`


@dataclass(frozen=True, eq=False)
class Library:
    """What a campaign can be searched for."""

    effects: Mapping[str, Effect]  # all effects, by id
    # of the effects that may be named and that the campaign can test, by effect and form
    forms: Mapping[tuple[str, str], Form]
    workmanship: Mapping[str, Form]  # its kinds, by the effect as which each is named if nothing else is found
    made_within: float | None = None  # known upper limit of workmanship, in the units of its parameters

    @classmethod
    def of(
        cls,
        rows: CampaignRows,
        chosen: Mapping[str, Effect],
        made_within: float | None = None,
        kept: Collection[tuple[str, str]] = (),
    ) -> Self:
        """Return the library for a campaign, of effects that may be named, by id.

        Forms in ``kept``, by effect and form, are included even if others do the same in these rows.

        Raises:
            BadInputError: an effect of a package violates the interface :class:`~pouring_robot.effects.base.Effect`.
        """
        given, channels = rows.conditions, rows.channels
        forms = {
            (effect.id, form.name): form
            for effect in chosen.values()
            if not effect.missing(given)
            for form in _distinct(effect.id, checked_forms(effect, given, channels), kept)
        }
        effects = all_effects(given.robot)
        kinds = {name: effect.workmanship(given) for name, effect in effects.items()}
        workmanship = {name: Form(WORKMANSHIP_FORM, found) for name, found in kinds.items() if found}
        return cls(effects, forms, workmanship, made_within)

    @property
    def every_form(self) -> dict[tuple[str, str], Form]:
        """Workmanship and forms of effects, by effect and form."""
        return {(effect, form.name): form for effect, form in self.workmanship.items()} | dict(self.forms)


def _distinct(effect: str, forms: Iterable[Form], kept: Collection[tuple[str, str]]) -> Iterator[Form]:
    """Yield forms without values of a constant that do in these rows what another form does, except those kept.

    Free play that no force takes up is plain play, whatever force would take it up.
    """
    known = set[tuple[bytes, ...]]()
    for form in forms:
        key = tuple(change.tobytes() for p in form.parameters if p.main for change in p.changes.values())
        if not form.one_of or key not in known or (effect, form.name) in kept:
            yield form
        known.add(key)


def workmanship_of(rows: CampaignRows, linear: LinearRows, library: Library) -> Iterator[Workmanship]:
    """Yield the kinds of workmanship with their columns in all equations."""
    within = math.inf if library.made_within is None else library.made_within
    for effect, form in library.workmanship.items():
        most = within / min(p.prior_std for p in form.parameters)
        yield Workmanship(effect, Signatures(rows, form.parameters, linear), most)


def known_effects(rows: CampaignRows, linear: LinearRows, library: Library) -> Iterator[Explanation]:
    """Yield what may be found, and the deflection of compliant joints, with their columns in all equations."""
    if rows.conditions.joint_moments and rows.conditions.robot.loops.loops:
        yield _softness(rows, linear)
    # Bounds hold for whole effects; a part that the model has already may have to become smaller.
    whole = not rows.model.effects and rows.model.heat is None
    for (effect, _), form in library.forms.items():
        main = np.array([p.main for p in form.parameters])
        bounds = np.array([np.divide(p.bounds, p.prior_std) for p in form.parameters])
        known = bounds if whole and np.isfinite(bounds).any() else None
        columns = Signatures(rows, form.parameters, linear)
        yield Explanation(effect, form.name, columns, main, one_of=form.one_of, bounds=known, series=form.series)


def _softness(rows: CampaignRows, linear: LinearRows) -> Explanation:
    """Return the deflection of joints under weight, with one compliance for all.

    Its unit is the assumed stiffness of the loops; the joints' own is estimated relative to it.
    """
    _, stiffness = rows.conditions.robot.mechanism().loops.stiffness_si
    moments = rows.conditions.joint_moments or {}
    turned = {name: moment / stiffness for name, moment in moments.items()}
    column = Signatures(rows, [EffectParameter("softness", "rad/rad", 1.0, turned)], linear)
    return Explanation(SOFTNESS, "soft_joints", column, np.ones(1, dtype=bool), cause=False)
