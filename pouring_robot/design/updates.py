"""Rank-m updates of the information of a plan, for all candidates at once: the arithmetic under the exchange."""

import numpy as np

from pouring_robot.mechanism.arrays import FloatArray


class InformationFactor:
    """C = M⁻¹ (``inverse``, (p, p)) over some columns, and the ``blocks`` X C Xᵀ of every candidate, (m, m, N).

    The whitened rows X of the N candidates have the shape (N, m, p), the information M of the present plan (p, p).
    """

    def __init__(self, rows: FloatArray, information: FloatArray) -> None:
        self._rows = rows
        self._across = np.ascontiguousarray(rows.transpose(2, 1, 0))  # (p, m, N)
        self.restart(information)

    def restart(self, information: FloatArray) -> None:
        """Take C and all blocks from scratch."""
        self.inverse: FloatArray = np.asarray(np.linalg.inv(information), dtype=float)
        root = np.linalg.cholesky(0.5 * (self.inverse + self.inverse.T))
        half = np.tensordot(root.T, self._across, axes=1)
        self.blocks: FloatArray = np.einsum("kan,kbn->abn", half, half)

    def without(self, candidate: int) -> tuple[FloatArray, FloatArray]:
        """Return C and the blocks once a candidate is out."""
        return self._update(self.inverse, self.blocks, candidate, -1.0)

    def put(self, inverse: FloatArray, blocks: FloatArray, candidate: int) -> None:
        """Keep C and blocks with a candidate added."""
        self.inverse, self.blocks = self._update(inverse, blocks, candidate, 1.0)

    def _update(
        self, inverse: FloatArray, blocks: FloatArray, candidate: int, sign: float
    ) -> tuple[FloatArray, FloatArray]:
        """Woodbury: adding (sign 1) or removing (-1) the rows of one candidate."""
        own = self._rows[candidate]
        middle = np.linalg.inv(np.eye(len(own)) + sign * blocks[:, :, candidate])
        root = np.linalg.cholesky(0.5 * (middle + middle.T))
        reach = inverse @ own.T @ root  # (p, m)
        seen = np.tensordot(reach.T, self._across, axes=1)  # (m, m of candidate, N)
        changed = blocks.copy()
        for part in seen:
            changed -= sign * part[:, None, :] * part[None, :, :]
        return inverse - sign * reach @ reach.T, changed


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
