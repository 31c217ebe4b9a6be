r"""Base parameters: which combinations of the unknowns the measurements determine, and which they cannot.

Linearly dependent columns of the whitened regressor W move the ladle alike at every measured pose; only a combination
of them can be identified. QR with column pivoting, :math:`W P = Q [R_1 R_2; 0\ 0]`, splits them into base columns and
dependent ones, :math:`W_d = W_b R_1^{-1} R_2` (Gautier, *Numerical calculation of the base inertial parameters of
robots*, J. Robotic Systems 8, 1991; Gautier & Khalil, IEEE T-RA 6, 1990). Observability indices state how well the base
is determined, each larger for better poses (Hollerbach & Wampler, *The calibration index and taxonomy for robot
kinematic calibration methods*, IJRR 15, 1996; Sun & Hollerbach, *Observability index selection for robot calibration*,
ICRA 2008), for n poses and the singular values :math:`\sigma_1 \ge \dots \ge \sigma_m`:

====  ==========================================  ==========================================================
O1    :math:`(\sigma_1 \cdots \sigma_m)^{1/m} / \sqrt n`  Borm and Menq 1991; the best plan is the D_s-optimal one
O2    :math:`\sigma_m / \sigma_1`                  Driels and Pathre 1990, inverse condition number
O3    :math:`\sigma_m`                             Nahvi, Hollerbach and Hayward 1994
O4    :math:`\sigma_m^2 / \sigma_1`                Nahvi and Hollerbach 1996, noise amplification index
O5    :math:`1 / \sum_k 1/\sigma_k`                Sun and Hollerbach 2008
====  ==========================================  ==========================================================

Only O1 does not depend on the units of the parameters; the others assume parameters in units of comparable size.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
import scipy.linalg
from scipy.sparse.csgraph import connected_components

from pouring_robot.exceptions import BadInputError
from pouring_robot.mechanism.arrays import FloatArray

Criterion = Literal["D", "O1", "O2", "O3", "O4", "O5"]
CRITERIA: tuple[Criterion, ...] = get_args(Criterion)  # observability indices; D is O1
_ENDS = {"O2": (1, -1), "O3": (1, 0), "O4": (2, -1)}  # powers of the least and the largest singular value
RANK_TOLERANCE = 1e-9
"""Anything below is round-off of an exact zero: of a column's length against the longest (per metre and per radian),
and of a singular value against the largest, with columns scaled to unit length. Solving for G magnifies round-off of
2e-16 by the closure's condition number: analytic zeros come out at up to 2e-11 on the drawing, the least true column at
2e-2 and the least true singular value at 1e-6, so the threshold is in a gap of four decades and more (a test checks
this)."""
_NO_SHARE = 1e-6
_TIE = 1e-7  # above what updated column norms lose in pivoting, √ε = 1.5e-8 (LAPACK Working Note 176)


@dataclass(frozen=True)
class DependentGroup:
    """Linearly dependent unknowns: fewer combinations of them can be identified than there are members."""

    members: tuple[str, ...]  # their names
    combinations: tuple[dict[str, float], ...]  # identifiable: for each base member every member's share per unit
    hidden: int  # number of directions that no measurement at these poses shows

    def texts(self) -> tuple[str, ...]:
        """Return each identifiable combination as a line: ``leg1_s1.tx + 0.5 leg1_s2.tx``."""
        return tuple(combination_text(combination) for combination in self.combinations)


def combination_text(combination: dict[str, float]) -> str:
    """Return a combination as a line: ``leg1_s1.tx + 0.5 leg1_s2.tx``."""
    terms = []
    for k, (name, share) in enumerate(combination.items()):
        sign = ("- " if share < 0.0 else "+ ") if k else ("-" if share < 0.0 else "")
        size = "" if abs(abs(share) - 1.0) < 1e-9 else f"{abs(share):.4g} "
        terms.append(f"{sign}{size}{name}")
    return " ".join(terms)


@dataclass(frozen=True, eq=False)
class BaseParameters:
    """What a regressor determines."""

    names: tuple[str, ...]  # of its columns
    rank: int  # number of combinations that are determined
    singular: FloatArray  # singular values of the columns scaled to unit length, shape (K,)
    base: tuple[str, ...]  # names of the columns kept by pivoting; the others depend on them
    groups: tuple[DependentGroup, ...]  # of dependent unknowns
    unseen: tuple[str, ...]  # columns that are zero: no measurement changes with them

    @property
    def deficient(self) -> bool:
        """Whether some direction cannot be determined."""
        return self.rank < len(self.names)


def base_parameters(
    matrix: FloatArray, names: Sequence[str], tolerance: float = RANK_TOLERANCE, lead: Sequence[str] = ()
) -> BaseParameters:
    """Split the K named columns of a whitened regressor (m, K).

    Names in ``lead``, such as the frames, represent their group where there is a choice; for ``tolerance`` see
    :data:`RANK_TOLERANCE`. Raises BadInputError if the shapes do not match or the matrix is not finite.
    """
    names = tuple(names)
    if matrix.ndim != 2 or matrix.shape[1] != len(names) or not np.isfinite(matrix).all():
        raise BadInputError(f"a regressor needs shape (m, {len(names)}) and finite entries, not {matrix.shape}")
    lengths = np.linalg.norm(matrix, axis=0)
    seen = lengths > tolerance * max(float(lengths.max(initial=0.0)), np.finfo(float).tiny)
    scale = np.where(seen, lengths, 1.0)
    # QR first: from here on m does not matter. Columns that are zero stay exactly zero.
    compact = np.asarray(np.linalg.qr(np.where(seen, matrix / scale, 0.0), mode="r"), dtype=np.float64)
    singular = np.linalg.svd(compact, compute_uv=False)
    singular = np.r_[singular, np.zeros(len(names) - singular.size)]
    rank = int((singular > tolerance * singular[0]).sum()) if seen.any() else 0
    # The robot is symmetric, so columns tie; the earlier one then represents them, not the one round-off favours.
    weight = np.array([1e3 if name in lead else 1.0 for name in names]) * (1.0 - _TIE * np.arange(len(names)))
    _, _, pivots = scipy.linalg.qr(compact * weight, mode="economic", pivoting=True)
    kept, dependent = pivots[:rank], pivots[rank:]
    shares = np.asarray(np.linalg.lstsq(compact[:, kept], compact[:, dependent], rcond=None)[0], dtype=np.float64)
    base, unseen = (tuple(names[k] for k in columns) for columns in (np.sort(kept), np.flatnonzero(~seen)))
    return BaseParameters(names, rank, singular, base, _groups(names, kept, dependent, shares, scale), unseen)


def robot_combinations(base: BaseParameters, frames: Sequence[str]) -> list[dict[str, float]]:
    """Return the identifiable combinations without the outer frames, which led the base parameters.

    Base columns that belong to no group are combinations by themselves.
    """
    tied = [combination for group in base.groups for combination in group.combinations]
    members = {name for group in base.groups for name in group.members}
    alone = [{name: 1.0} for name in base.base if name not in members]
    return [combination for combination in (*tied, *alone) if not set(frames) & set(combination)]


def _groups(
    names: tuple[str, ...], kept: np.ndarray, dependent: np.ndarray, shares: FloatArray, scale: FloatArray
) -> tuple[DependentGroup, ...]:
    """Return the connected parts: a dependent column connects all base columns it is a combination of."""
    graph = np.zeros((len(names), len(names)))  # of all unknowns: which dependent one has a share of which base
    graph[np.ix_(kept, dependent)] = np.where(np.abs(shares) > _NO_SHARE, shares, 0.0)
    parts = connected_components(graph, directed=False)[1]
    groups = []
    for part in dict.fromkeys(parts.tolist()):
        members = np.flatnonzero(parts == part)
        base, hidden = (members[np.isin(members, some)] for some in (kept, dependent))
        if base.size and hidden.size:
            combinations = tuple(
                {names[b]: 1.0} | {names[d]: float(graph[b, d] * scale[d] / scale[b]) for d in hidden if graph[b, d]}
                for b in base
            )
            groups.append(DependentGroup(tuple(names[k] for k in members), combinations, len(hidden)))
    return tuple(groups)


def observability_index(singular_values: FloatArray, criterion: Criterion, poses: int) -> FloatArray:
    """Return an observability index of non-negative singular values (..., m); D is O1, which depends on ``poses``.

    Shape (...), larger is better; 0 where a combination is not determined.
    """
    values = np.asarray(singular_values, dtype=float)
    low, high = values.min(axis=-1), values.max(axis=-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        if criterion in _ENDS:
            of_low, of_high = _ENDS[criterion]
            return np.asarray(np.where(high > 0.0, low**of_low * high**of_high, 0.0))
        if criterion == "O5":
            return np.asarray(1.0 / (1.0 / values).sum(axis=-1))
        return np.asarray(np.exp(np.log(values).mean(axis=-1)) / np.sqrt(poses))


def index_slopes(singular_values: FloatArray, criterion: Criterion, poses: int) -> FloatArray:
    """Return the derivative of an index by the squares of the singular values; both have the shape (m,)."""
    values = np.maximum(singular_values, RANK_TOLERANCE * np.max(singular_values))
    index, places = observability_index(values, criterion, poses), np.arange(len(values))
    power = index / values if criterion == "O5" else np.full(len(values), 1.0 / len(values))  # of each in the index
    if criterion in _ENDS:
        of_low, of_high = _ENDS[criterion]
        power = of_low * (places == values.argmin()) + of_high * (places == values.argmax())
    return np.asarray(0.5 * index * power / values**2)


def observability(singular: FloatArray, rows: int) -> dict[str, float]:
    """Return the observability indices O1 to O5, by name, of singular values (r,) for so many poses; 0 without any."""
    return {name: float(observability_index(singular, name, rows)) if singular.size else 0.0 for name in CRITERIA[1:]}
