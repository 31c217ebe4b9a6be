"""What a diagnosis of focus rows says: named effects, nights that are off, what is undecided, step by step."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pouring_robot.exceptions import DiagnosisError
from pouring_robot.inference.thresholds import Thresholds
from pouring_robot.mechanism.arrays import FloatArray

from .data import FocusRows
from .model import NIGHT, PRIOR_STD_UM, STORIES, constants, descriptions, forms, is_night, problem_of
from .unknown_noise import Key, Keys, UnknownNoise

LEAST_ROWS = 12
STRUCTURE = 3.0
"""Log evidence from which the remainder counts as structured, in nats."""
_NOISES = 28


@dataclass(frozen=True, eq=False)
class Fit:
    """Least squares with the constants.

    Attributes:
        values: shape (k,): the parameters without the constants.
        covariance: shape (k, k), with the noise that is left.
        left: shape (n,): residuals, in µm.
        std_um: residual standard deviation, degrees of freedom taken off.
    """

    values: FloatArray
    covariance: FloatArray
    left: FloatArray
    std_um: float


def least_squares(rows: FocusRows, columns: list[FloatArray]) -> Fit:
    """Return the fit of columns (n, k) beside each instrument's constant.

    Raises:
        DiagnosisError: the rows do not determine the parameters.
    """
    zero = constants(rows)
    table = np.hstack([*columns, zero])
    values, _, rank, _ = np.linalg.lstsq(table, rows.focus_um, rcond=1e-10)
    degrees = len(rows) - table.shape[1]
    if rank < table.shape[1] or degrees < 1:
        raise DiagnosisError(
            f"{len(rows)} rows do not determine {table.shape[1]} parameters", "give more different rows"
        )
    left = rows.focus_um - table @ values
    std = float(np.sqrt(left @ left / degrees))
    own = table.shape[1] - zero.shape[1]
    covariance: FloatArray = std**2 * np.linalg.inv(table.T @ table)[:own, :own]
    return Fit(np.asarray(values[:own], dtype=np.float64), covariance, np.asarray(left), std)


class Findings:
    """Diagnosis of rows that have all conditions.

    Args:
        rows: complete rows.
        thresholds: what an explanation must be worth.

    Raises:
        DiagnosisError: too few rows, or a focus that never changes.
    """

    def __init__(self, rows: FocusRows, thresholds: Thresholds | None = None) -> None:
        """Search."""
        if len(rows) < LEAST_ROWS:
            raise DiagnosisError(f"{len(rows)} complete rows, {LEAST_ROWS} are needed", "give more rows")
        spread = least_squares(rows, []).std_um
        if spread <= 1e-9 * float(np.abs(rows.focus_um).max(initial=1.0)):
            raise DiagnosisError("the focus is the same in every row", "give the table as it was measured")
        self.rows, self.thresholds = rows, thresholds or Thresholds()
        self.forms = forms(rows)
        noises = np.geomspace(spread / 40.0, 1.2 * spread, _NOISES)
        choice = float(np.log(max(sum(is_night(key) for key in self.forms), 1)))
        self.core = UnknownNoise(
            problem_of(rows), noises, self.thresholds, lambda key: choice if is_night(key) else 0.0
        )
        self.keys: Keys = self.core.best()

    @property
    def causes(self) -> Keys:
        """Explanations that name a cause."""
        return tuple(key for key in self.keys if not is_night(key))

    @property
    def nights(self) -> Keys:
        """Nights with an offset of their own, the cause of which nobody knows."""
        return tuple(key for key in self.keys if is_night(key))

    @cached_property
    def noise_um(self) -> float:
        """Mean of the noise under what was found."""
        return self.core.noise(self.keys)[0]

    def fit(self, keys: Keys) -> Fit:
        """Return the least-squares fit of some explanations."""
        return least_squares(self.rows, [self.forms[key].columns for key in keys])

    def worth(self, key: Key) -> float:
        """Return what an explanation is worth beside the rest of what was found, in nats."""
        rest = [other for other in self.keys if other != key]
        return self.core.weighed([*rest, key]).log_evidence - self.core.weighed(rest).log_evidence

    def instead(self, key: Key) -> list[tuple[Key, float]]:
        """Return other effects in the place of a found explanation, and by how many nats they are better."""
        rest = [other for other in self.keys if other != key]
        taken = {other[0] for other in self.keys}
        here = self.core.weighed(self.keys).log_evidence
        tried = [other for other in self.forms if other[0] not in taken and not is_night(other)]
        found = [(other, self.core.weighed([*rest, other]).log_evidence - here) for other in tried]
        return sorted((pair for pair in found if np.isfinite(pair[1])), key=lambda pair: -pair[1])

    def probability(self, key: Key) -> float:
        """Return the probability of an effect against other known effects, and none, in its place."""
        others = [better for _, better in self.instead(key)]
        return float(1.0 / (1.0 + np.exp(np.minimum([*others, -self.worth(key)], 50.0)).sum()))

    def parameters(self, key: Key) -> dict[str, dict[str, float | str]]:
        """Return value and standard deviation of each parameter of what was found, noise integrated over."""
        mean, covariance = self.core.coefficients(self.keys, key)
        form, std = self.forms[key], np.sqrt(np.diag(covariance))
        return {
            name: {"value": PRIOR_STD_UM * float(m), "std": PRIOR_STD_UM * float(s), "unit": unit}
            for name, unit, m, s in zip(form.names, form.units, mean, std, strict=True)
        }

    def steps(self) -> list[tuple[Keys, Fit]]:
        """Return the least-squares fit with nothing, then with one explanation more at a time."""
        ordered = (*self.causes, *self.nights)
        return [(ordered[:count], self.fit(ordered[:count])) for count in range(len(ordered) + 1)]

    def undecided(self) -> list[tuple[Key, float, Fit, float]]:
        """Return each form not found that could still matter: evidence, its fit (its values first), reach in µm.

        Its reach is how far it might still move the focus between two of the measured rows (95 % limit); it could
        matter if that exceeds the noise.
        """
        found = []
        for key in self._not_found:
            fit, columns = self._beside(key), self.forms[key].columns
            if fit is None:
                continue
            width = columns.shape[1]
            reach = _reach(columns, fit.values[:width], fit.covariance[:width, :width])
            if reach > self.noise_um:
                found.append((key, self.worth(key), fit, reach))
        return sorted(found, key=lambda item: -item[1])

    @property
    def untestable(self) -> list[str]:
        """Effects that these rows cannot show: a condition is missing, never changes, or goes with what was found."""
        shown = {key[0] for key in self._not_found if self._beside(key) is not None} | {key[0] for key in self.keys}
        return [effect for effect in STORIES if effect not in shown]

    @property
    def _not_found(self) -> Keys:
        taken = {key[0] for key in self.keys}
        return tuple(key for key in self.forms if key[0] not in taken and not is_night(key))

    def _beside(self, key: Key) -> Fit | None:
        """Return the fit of a form beside what was found; None where the rows do not determine it."""
        try:
            return self.fit((key, *self.keys))
        except DiagnosisError:
            return None

    def structures(self, keys: Keys) -> list[tuple[str, float]]:
        """Return what the remainder of some explanations depends on, with the evidence in nats."""
        return [
            (name, value) for name, value in self.core.structures(keys, descriptions(self.rows)) if value >= STRUCTURE
        ]

    def likeness(self, one: Key, other: Key) -> float:
        """Return the cosine between two effects of one parameter on these rows, constants taken out."""
        zero = constants(self.rows)
        first, second = (self.forms[key].columns[:, 0] for key in (one, other))
        first, second = (v - zero @ np.linalg.lstsq(zero, v, rcond=None)[0] for v in (first, second))
        return float(first @ second / np.linalg.norm(first) / np.linalg.norm(second))


def _reach(columns: FloatArray, values: FloatArray, covariance: FloatArray) -> float:
    apart = (columns[:, None] - columns[None]).reshape(-1, columns.shape[1])
    spread = np.sqrt(np.einsum("ni,ij,nj->n", apart, covariance, apart))
    return float((np.abs(apart @ values) + 1.96 * spread).max())


def repeats_um(rows: FocusRows, left: FloatArray, within_k: float = 0.3) -> tuple[float, int]:
    """Return noise from pairs of one night within a temperature of each other, and how many pairs there are.

    Args:
        rows: the rows.
        left: shape (n,): residuals, in µm.
        within_k: largest difference of truss temperature, in K.
    """
    first, second = np.triu_indices(len(rows), 1)
    near = np.abs(rows.truss_degc[first] - rows.truss_degc[second]) < within_k
    alike = near & (rows.night[first] == rows.night[second]) & (rows.instrument[first] == rows.instrument[second])
    apart = (left[first] - left[second])[alike]
    return (float(np.sqrt((apart**2).mean() / 2.0)) if apart.size else float("nan")), int(apart.size)


def night_name(key: Key) -> str:
    """Return the night of an explanation, YYYYMMDD."""
    return key[0].removeprefix(f"{NIGHT} ")
