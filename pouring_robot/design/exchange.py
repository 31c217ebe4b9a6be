r"""Exchange: choosing rows of a plan from a dense set of candidates, one swap at a time.

Fedorov's exchange in the form of Cook and Nachtsheim (Technometrics 22, 1980): each pose of the plan in turn is
replaced by the best of all candidates, until a whole round changes nothing; it starts from several random plans, and
the best result is kept. A pose has a block X of m measured rows, so a swap is a rank-m update. With C = M⁻¹,

.. math:: \det(M + X^T X) = \det M \, \det(I + X C X^T)

and the blocks :math:`K_j = X_j C X_j^T` of all candidates are updated with it, so that a round costs n products of the
candidates with a p × m matrix. D_s-optimality maximises det M / det M_ff; both factors are updated in this way. For O2
to O5 the swaps that their derivative and the determinant recommend are evaluated exactly.

The computation is well conditioned because it uses a basis in which the mean information of the candidates is the unit
matrix: determinants only change by a constant, whatever the units and however similar the effects of parameters are.
"""

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
import scipy.linalg

from pouring_robot.estimation.identifiability import RANK_TOLERANCE, Criterion, index_slopes, observability_index
from pouring_robot.exceptions import BadInputError
from pouring_robot.io.progress import Progress, say_nothing
from pouring_robot.io.seeds import Stream, generator
from pouring_robot.mechanism.arrays import BoolArray, FloatArray, Indices

# Keeps random first plans regular; relative to a mean information of one it changes no decision.
_RIDGE = 1e-6
_LEAST_GAIN = 1e-9
_ROUNDS = 60
_SHORTLIST = 16


@dataclass(frozen=True, eq=False)
class CandidateSet:
    """The candidates to choose from."""

    rows: FloatArray  # whitened, of each candidate, shape (N, m, p), ``nuisance`` columns first; unused ones are zero
    nuisance: int
    place: Indices  # candidates with the same number are the same pose: at most one of them is chosen, shape (N,)
    kind: Indices  # of each candidate, shape (N,); a slot of the plan takes one kind
    inverse_std: FloatArray  # one over the prior standard deviation of each unknown, shape (p,), 0 for none


def choose(
    candidates: CandidateSet,
    slots: Sequence[int] | Indices,
    criterion: Criterion = "D",
    *,
    seed: int = 0,
    starts: int = 4,
    progress: Progress = say_nothing,
) -> Indices:
    """Return the best plan that exchange finds from ``starts`` first plans: the candidate of each slot, (n,).

    ``slots`` has the kind of each of the n slots; the same seed gives the same plan, and so do the criteria D and O1.
    Raises BadInputError if there are fewer poses to choose from than slots.
    """
    slots = np.asarray(slots, dtype=np.intp)
    search = _Search(candidates, slots, criterion)
    random = generator(seed, Stream.EXCHANGE)
    best, most = np.empty(0, dtype=np.intp), -np.inf
    for start in range(starts):
        # In turn: by determinant first, which is mostly good; the best so far, perturbed; random, for other optima.
        first = search.random_plan(random)
        if start % 3 == 1:
            first = search.shaken(best, first, random)
        value, found = search.improve(first, random, determinant_first=start % 3 == 0)
        if value > most:
            best, most = found, value
        progress("exchanging poses", start + 1, starts)
    return best


@dataclass(frozen=True, eq=False)
class InformationFactor:
    """C = M⁻¹ over some columns, and its blocks for every candidate; M is the information of a plan."""

    rows: FloatArray  # X, whitened, of the N candidates, shape (p, m, N)
    inverse: FloatArray  # C, shape (p, p)
    blocks: FloatArray  # X C Xᵀ of each candidate, shape (m, m, N)

    @classmethod
    def of(cls, rows: FloatArray, information: FloatArray) -> Self:
        """Return C for M (p, p), and all blocks, computed from scratch."""
        inverse: FloatArray = np.asarray(np.linalg.inv(information), dtype=float)
        root = np.linalg.cholesky(0.5 * (inverse + inverse.T))
        half = np.tensordot(root.T, rows, axes=1)
        return cls(rows, inverse, np.einsum("kan,kbn->abn", half, half))

    def updated(self, candidate: int, sign: float) -> Self:
        """Return the same with the rows of one candidate added (sign 1) or removed (-1), by Woodbury's formula."""
        middle = np.linalg.inv(np.eye(len(self.blocks)) + sign * self.blocks[:, :, candidate])
        root = np.linalg.cholesky(0.5 * (middle + middle.T))
        reach = self.inverse @ self.rows[:, :, candidate] @ root  # (p, m)
        seen = np.tensordot(reach.T, self.rows, axes=1)  # (m, m of candidate, N)
        blocks = self.blocks.copy()
        for part in seen:
            blocks -= sign * part[:, None, :] * part[None, :, :]
        return replace(self, inverse=self.inverse - sign * reach @ reach.T, blocks=blocks)


_Factors = list[InformationFactor]  # without the pose of a slot: over all columns, and over the nuisance columns
_Best = Callable[[Indices, int, _Factors], int]  # returns the candidate that is best in a slot of a plan


def log_determinants(blocks: FloatArray) -> FloatArray:
    """Return log det(I + block) of symmetric blocks (m, m, N), all at once by Cholesky; shape (N,)."""
    size = len(blocks)
    lower = blocks + np.eye(size)[:, :, None]
    total = np.zeros(blocks.shape[2])
    for k in range(size):
        pivot = np.maximum(lower[k, k], np.finfo(float).tiny)
        total += np.log(pivot)
        column = lower[k + 1 :, k] / pivot
        lower[k + 1 :, k + 1 :] -= column[:, None] * lower[None, k, k + 1 :]
    return total


class _Search:
    """Exchange over one candidate set. The basis: see the module."""

    def __init__(self, candidates: CandidateSet, slots: Indices, criterion: Criterion) -> None:
        self.slots, self.criterion, self.nuisance = slots, criterion, candidates.nuisance
        self.place, self.kind = candidates.place, candidates.kind
        self._at = {where: k for k, where in enumerate(zip(self.place.tolist(), self.kind.tolist(), strict=True))}
        for kind in np.unique(slots):
            # Each place may also be needed by slots of another kind.
            if len(np.unique(self.place[self.kind == kind])) < len(slots):
                raise BadInputError(f"a plan of {len(slots)} poses needs more candidates to choose from")
        count, _, unknowns = candidates.rows.shape
        prior = np.diag(candidates.inverse_std) / np.sqrt(len(slots))
        stack = np.concatenate([candidates.rows.reshape(-1, unknowns) / np.sqrt(count), prior])
        triangle: FloatArray = np.asarray(np.linalg.qr(stack, mode="r"))
        own = np.abs(np.diagonal(triangle))
        if len(own) < unknowns or np.any(own <= RANK_TOLERANCE * np.linalg.norm(triangle, axis=0)):
            raise BadInputError(
                "even all candidates together do not determine the unknowns; leave some unknowns out or give priors"
            )
        flat = scipy.linalg.solve_triangular(triangle, candidates.rows.reshape(-1, unknowns).T, trans="T").T
        self.rows = np.ascontiguousarray(flat.reshape(candidates.rows.shape))
        weights = scipy.linalg.solve_triangular(triangle, np.diag(candidates.inverse_std), trans="T")
        self.base = weights @ weights.T + _RIDGE * len(slots) * np.eye(unknowns)
        self.units = triangle[self.nuisance :, self.nuisance :]
        widths = unknowns, self.nuisance
        self.across = [np.ascontiguousarray(self.rows[:, :, :width].transpose(2, 1, 0)) for width in widths]

    def random_plan(self, random: np.random.Generator) -> Indices:
        """Return a plan with each place at most once."""
        chosen = np.empty(0, dtype=np.intp)
        for kind in self.slots.tolist():
            free = np.flatnonzero((self.kind == kind) & ~np.isin(self.place, self.place[chosen]))
            chosen = np.append(chosen, random.choice(free))
        return chosen

    def shaken(self, plan: Indices, other: Indices, random: np.random.Generator) -> Indices:
        """Return a plan with about a third of its slots taken from another plan where these candidates are free."""
        mixed = plan.copy()
        for slot in random.permutation(len(plan))[: max(2, len(plan) // 3)].tolist():
            if self._open(mixed, slot)[other[slot]]:
                mixed[slot] = other[slot]
        return mixed

    def improve(
        self, chosen: Indices, random: np.random.Generator, *, determinant_first: bool
    ) -> tuple[float, Indices]:
        """Exchange until nothing improves; return the index and the plan."""
        by_determinant = self.criterion in ("D", "O1")
        if determinant_first and not by_determinant:
            chosen = self._run(chosen, random, self._by_determinant)
        while True:
            chosen = self._run(chosen, random, self._by_determinant if by_determinant else self._by_index)
            if not self._trade_kinds(chosen):
                return float(self._indices(self._information(chosen)[None])[0]), chosen

    def _run(self, chosen: Indices, random: np.random.Generator, best: _Best) -> Indices:
        chosen = chosen.copy()
        for _ in range(_ROUNDS):
            information, before = self._information(chosen), chosen.copy()
            factors = [InformationFactor.of(rows, information[: len(rows), : len(rows)]) for rows in self.across]
            for slot in random.permutation(len(chosen)).tolist():
                out = [factor.updated(int(chosen[slot]), -1.0) for factor in factors]
                candidate = best(chosen, slot, out)
                if candidate != chosen[slot]:
                    factors = [factor.updated(candidate, 1.0) for factor in out]
                    chosen[slot] = candidate
            if np.array_equal(chosen, before):
                break
        return chosen

    def _information(self, chosen: Indices) -> FloatArray:
        rows = self.rows[chosen].reshape(-1, self.rows.shape[2])
        return np.asarray(self.base + rows.T @ rows)

    def _open(self, chosen: Indices, slot: int) -> BoolArray:
        """Return which candidates may take a slot, shape (N,)."""
        others = np.delete(self.place[chosen], slot)
        return np.asarray((self.kind == self.slots[slot]) & ~np.isin(self.place, others))

    def _gains(self, out: _Factors) -> FloatArray:
        return log_determinants(out[0].blocks) - log_determinants(out[1].blocks)

    def _by_determinant(self, chosen: Indices, slot: int, out: _Factors) -> int:
        gains, present = self._gains(out), int(chosen[slot])
        gains[~self._open(chosen, slot)] = -np.inf
        best = int(np.argmax(gains))
        return best if gains[best] > gains[present] + _LEAST_GAIN else present

    def _by_index(self, chosen: Indices, slot: int, out: _Factors) -> int:
        """Return the best candidate by the index, of those that look best by its derivative or by the determinant."""
        others, may, present = self._information(np.delete(chosen, slot)), self._open(chosen, slot), int(chosen[slot])
        promises = (self._promise(others), self._promise(self._information(chosen)), self._gains(out))
        ranked = [np.argsort(np.where(may, -one, np.inf), kind="stable")[:_SHORTLIST] for one in promises]
        shortlist = np.unique(np.concatenate([*ranked, [present]]))
        shortlist = shortlist[may[shortlist]]
        added = self.rows[shortlist]
        scores = self._indices(others + np.swapaxes(added, 1, 2) @ added)
        best = int(np.argmax(scores))
        better = scores[best] > scores[shortlist == present][0] * (1.0 + _LEAST_GAIN)
        return int(shortlist[best]) if better else present

    def _trade_kinds(self, chosen: Indices) -> bool:
        """Exchange the places of two slots of different kinds, in place, where that gains most; return whether it did.

        A single swap cannot do that: each place is taken by the other slot.
        """
        trades, information = [], []
        for a, b in itertools.combinations(range(len(chosen)), 2):
            there = self._at.get((int(self.place[chosen[b]]), int(self.slots[a])))
            here = self._at.get((int(self.place[chosen[a]]), int(self.slots[b])))
            if self.slots[a] != self.slots[b] and there is not None and here is not None:
                traded = chosen.copy()
                traded[a], traded[b] = there, here
                trades.append(traded)
                information.append(self._information(traded))
        scores = self._indices(np.array([self._information(chosen), *information]))
        best = int(np.argmax(scores))
        if not scores[best] > scores[0] * (1.0 + _LEAST_GAIN):
            return False
        chosen[:] = trades[best - 1]
        return True

    def _promise(self, information: FloatArray) -> FloatArray:
        """Return the derivative of the index in the direction of each candidate, shape (N,)."""
        f = self.nuisance
        lower = np.linalg.cholesky(information)
        _, values, directions = np.linalg.svd(lower[f:, f:].T @ self.units)
        slopes = index_slopes(values, self.criterion, len(self.slots))
        # A row (x_f, x_t) adds to S the square of x_t - x_f M_ff^-1 M_ft, here in the units of the parameters.
        passed = np.zeros((len(information), len(values)))
        passed[f:] = np.eye(len(values))
        passed[:f] = -np.linalg.solve(information[:f, :f], information[:f, f:])
        seen = self.rows @ (passed @ self.units @ directions.T)
        return np.asarray((seen**2).sum(axis=1) @ slopes)

    def _indices(self, information: FloatArray) -> FloatArray:
        """Return the index, in the units of the parameters, of information matrices (k, p, p); shape (k,)."""
        lower = np.linalg.cholesky(information)[:, self.nuisance :, self.nuisance :]
        values = np.linalg.svd(np.swapaxes(lower, 1, 2) @ self.units, compute_uv=False)
        return observability_index(np.asarray(values, dtype=float), self.criterion, len(self.slots))
