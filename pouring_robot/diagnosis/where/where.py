"""Where model and measurement disagree: by component, region and condition, in figures and in plain sentences.

    where = disagreements(diagnosis.free_residuals, rows.conditions)   # the given model, only the two frames fitted
    where.sentences                                 # most important first
    where.as_json()                                 # "where" of diagnosis.json

Everything that is called significant has passed Holm's correction over all tests made, at the level given: with noise
alone nothing is found with that probability. Sizes are in the axes of the fixed platform.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pouring_robot.diagnosis.where.fit import (
    COMPONENT,
    REGION,
    Finding,
    LackOfFit,
    components,
    lack_of_fit,
    overall,
    repeats,
)
from pouring_robot.diagnosis.where.regions import regions
from pouring_robot.diagnosis.where.selection import Selection, holm, select
from pouring_robot.diagnosis.where.terms import FreeResiduals, Term, channels, terms, untested
from pouring_robot.diagnosis.where.words import condition_sentence, size_text
from pouring_robot.effects.conditions import Conditions
from pouring_robot.exceptions import BadInputError
from pouring_robot.inference.nuisance import Nuisance

_FEWEST_ROWS = 12
_MINOR_SHARE = 0.005
_LEFT_P = 1e-3


@dataclass(frozen=True)
class Where:
    """Where model and measurement disagree.

    Attributes:
        fit: lack of fit.
        findings: what is significant, most important first.
        notes: what could not be looked at, and why.
        tests: number of tests that the correction covers.
        alpha: probability of any finding by noise alone.
        discrepancy: root mean square of what the conditions found leave, over the noise.
    """

    fit: LackOfFit
    findings: tuple[Finding, ...]
    notes: tuple[str, ...]
    tests: int
    alpha: float
    discrepancy: float

    @property
    def sentences(self) -> tuple[str, ...]:
        """What was found in words, then notes; what makes less than a 14th of it (rms) is left out."""
        by_component = [item for item in self.findings if item.what == COMPONENT]
        found: list[str] = []
        for item in self.findings:
            if item.what != COMPONENT and item.share >= _MINOR_SHARE:
                found.append(item.sentence)
            elif by_component and item is by_component[0]:
                found.append(_in_one(by_component))
        return (*(found or ["Model and measurement agree within the noise."]), *self.notes)

    def as_json(self) -> list[dict[str, object]]:
        """Return ``where`` of ``diagnosis.json``."""
        return [item.as_json() for item in self.findings]


def _in_one(found: Sequence[Finding]) -> str:
    """Return one sentence on all components, positions first."""
    sizes = [f"{item.component} by {size_text(item.size, item.turning)}" for item in found]
    return f"By component (rms, axes of the fixed platform): {', '.join(sizes)}."


def disagreements(data: FreeResiduals, conditions: Conditions, alpha: float = 0.01) -> Where:
    """Return where model and measurement disagree.

    Half of ``alpha`` goes to lack of fit, components, repeats and regions, half to dependence on conditions.

    Args:
        data: m whitened residuals of n rows; the model with only the two frames fitted.
        conditions: of the n rows.
        alpha: probability of any finding by noise alone.

    Raises:
        BadInputError: there are no more equations than the frames absorb, or shapes do not fit.
    """
    n, m = len(conditions), data.residual.size
    freedoms = m - data.nuisance.dof
    if not data.row.size == data.component.size == data.sigma.size == len(data.nuisance.axes) == m:
        raise BadInputError(f"residuals, rows, components, noise and nuisance columns must all count {m} equations")
    if freedoms < 1:
        raise BadInputError(f"{m} measured values cannot show more than the {data.nuisance.dof} unknowns of the frames")
    noted: list[str] = []
    if not data.noise_known:
        data = _scaled(data)
        noted.append("The noise is not known: sizes cannot be judged against it, only what they depend on.")
    ladle, drives = channels(data, n)
    family = [overall(data, freedoms), *components(data), *repeats(data, conditions)]
    fit = lack_of_fit(data, conditions, family[0].p_value)
    if n >= _FEWEST_ROWS:
        family += regions(data, conditions)
        found = terms(conditions, ladle, drives)
    else:
        found = []
        noted.append(f"{n} rows are too few to say what the disagreement depends on; measure {_FEWEST_ROWS} or more.")
    selection = select(data, found, 0.5 * alpha)
    general = _judged(family, 0.5 * alpha)
    by_condition = _by_condition(data, selection, found)
    missing = untested(conditions)
    if missing and n >= _FEWEST_ROWS:
        noted.append(f"Not measured or not varied, so nothing can be said of: {', '.join(missing)}.")
    rest = selection.residual
    spare = max(m - selection.fitted, 1)
    left = float(np.sqrt(rest @ rest / spare))
    if data.noise_known and found and data.excess(float(rest @ rest), spare) < _LEFT_P:
        noted.insert(0, f"Not explained by any condition looked at: {left:.1f} times the noise.")
    return Where(
        fit,
        tuple(_ordered(general, by_condition)),
        tuple(noted),
        len(family) + selection.tests,
        alpha,
        left,
    )


def _ordered(general: list[Finding], by_condition: list[Finding]) -> list[Finding]:
    """Return how much first, then what it depends on, then where in the workspace."""
    first = [f for f in general if f.what != REGION]
    return [*first, *by_condition, *[f for f in general if f.what == REGION][:1]]


def _scaled(data: FreeResiduals) -> FreeResiduals:
    """Return the same with the root mean square of positions and of rotations for noise."""
    factor = np.ones(data.residual.size)
    for turning in (False, True):
        chosen = (data.component >= 3) == turning
        if chosen.any():
            factor[chosen] = max(float(np.sqrt((data.cleared[chosen] ** 2).mean())), 1e-12)
    return replace(
        data,
        residual=data.residual / factor,
        sigma=data.sigma * factor,
        nuisance=Nuisance.of(data.nuisance.axes / factor[:, None]),
        drives=None if data.drives is None else data.drives / factor[:, None],
    )


def _judged(family: list[Finding], alpha: float) -> list[Finding]:
    """Return what is significant of a family, with corrected p-values; all sizes where noise is unknown."""
    with_p = [f for f in family if f.p_value is not None]
    corrected = holm(np.array([f.p_value for f in with_p], dtype=float))
    judged = {
        id(f): replace(f, p_value=min(2.0 * float(p), 1.0)) for f, p in zip(with_p, corrected.tolist(), strict=True)
    }
    kept = [judged.get(id(f), f) for f in family]
    return [f for f in kept if f.p_value is None or f.p_value < 2.0 * alpha]


def _by_condition(data: FreeResiduals, selection: Selection, found: Sequence[Term]) -> list[Finding]:
    out = []
    for rank, item in enumerate(selection.found):
        said = condition_sentence(data, selection, found, item, first=rank == 0)
        p_value = min(2.0 * min(item.p_values), 1.0)
        channel = said.channel
        out.append(
            Finding(
                "condition",
                channel.name,
                item.condition,
                said.size,
                channel.turning,
                p_value,
                said.text,
                item.rivals,
                item.share,
            )
        )
    return out
