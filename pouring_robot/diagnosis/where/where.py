"""Where model and measurement disagree: by component, region and condition, in figures and in plain sentences.

Everything significant has passed Holm's correction over all tests made, or an equivalent Bayes factor, at the given
level: with noise alone, anything is found with no more than that probability. Sizes are in the base's axes.
"""

from dataclasses import dataclass, replace

import numpy as np

from pouring_robot.diagnosis.where.dependence import dependence, untested
from pouring_robot.diagnosis.where.free_residuals import Finding, FreeResiduals, size_text
from pouring_robot.diagnosis.where.misfit import components, overall, regions, repeats
from pouring_robot.effects.conditions import Conditions
from pouring_robot.io.threads import one_blas_thread
from pouring_robot.mechanism.arrays import FloatArray

_FEWEST_ROWS = 12
_MINOR_SHARE = 0.005


@dataclass(frozen=True)
class Where:
    """Where model and measurement disagree."""

    findings: tuple[Finding, ...]  # what is significant, most important first
    notes: tuple[str, ...]  # what could not be tested, and why
    base: str  # the body in whose axes components are

    @property
    def sentences(self) -> tuple[str, ...]:
        """Findings in words, then notes; what makes less than a 14th of the disagreement (rms) is left out."""
        by_component = [item for item in self.findings if item.what == "component"]
        found: list[str] = []
        for item in self.findings:
            if item.what != "component" and item.share >= _MINOR_SHARE:
                found.append(item.sentence)
            elif by_component and item is by_component[0]:
                sizes = ", ".join(f"{f.component} {size_text(f.size, f.turning)}" for f in by_component)
                found.append(f"By component (rms, axes of the {self.base}): {sizes}.")
        return (*(found or ["Model and measurement agree within the noise."]), *self.notes)

    def figures(self) -> list[dict[str, object]]:
        """Return ``where`` of ``diagnosis.json``."""
        return [item.figures() for item in self.findings]


@one_blas_thread()
def disagreements(data: FreeResiduals, conditions: Conditions, alpha: float) -> Where:
    """Return where model and measurement disagree.

    ``alpha`` is the probability of any finding by noise alone: half of it is for lack of fit, components, repeats and
    regions, half for dependence on conditions.
    """
    n, dof = len(conditions), data.residual.size - data.nuisance.dof
    noted: list[str] = []
    scaled = data if data.noise_known else data.scaled(data.cleared)
    if not data.noise_known:
        noted.append("The noise is not known: sizes cannot be compared with it; only what they depend on can be found.")
    general = [overall(scaled, dof), *components(scaled), *repeats(scaled, conditions)]
    depends: list[Finding] = []
    if n >= _FEWEST_ROWS:
        general += regions(scaled, conditions)
        depends, settled = dependence(scaled, conditions, 0.5 * alpha)
        if not settled:
            noted.append(
                "The estimate of the noise did not settle, so sizes of what it depends on are rough: state it."
            )
        if missing := untested(conditions):
            noted.append(f"Not measured or not varied, so nothing is known of: {', '.join(missing)}.")
    else:
        noted.append(f"{n} rows are too few to say what the disagreement depends on; measure {_FEWEST_ROWS} or more.")
    general = _judged(general, 0.5 * alpha)
    # First how large, then what it depends on, then where in the workspace.
    findings = (
        *(f for f in general if f.what != "region"),
        *depends,
        *[f for f in general if f.what == "region"][:1],
    )
    of_both_halves = tuple(f if f.p_value is None else replace(f, p_value=min(2.0 * f.p_value, 1.0)) for f in findings)
    return Where(of_both_halves, tuple(noted), conditions.causes.words.base)


def _judged(family: list[Finding], alpha: float) -> list[Finding]:
    """Return the significant findings of a family, with corrected p-values; all sizes where the noise is unknown."""
    corrected = iter(holm(np.array([f.p_value for f in family if f.p_value is not None])).tolist())
    kept = [f if f.p_value is None else replace(f, p_value=next(corrected)) for f in family]
    return [f for f in kept if f.p_value is None or f.p_value < alpha]


def holm(p_values: FloatArray) -> FloatArray:
    """Return p-values (k,) corrected by Holm's step-down rule, which holds whatever the dependence between tests."""
    order = np.argsort(p_values, kind="stable")
    stepped = np.maximum.accumulate(p_values[order] * np.arange(p_values.size, 0, -1))
    corrected = np.empty(p_values.size)
    corrected[order] = np.minimum(stepped, 1.0)
    return corrected
