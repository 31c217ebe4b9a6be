"""A network of lumped temperatures: nodes, conduction between them, films and radiation to melt and surroundings.

Heat flow into node i, in W, with temperatures in K:

    Q_i = -Σ_j K_ij T_j + m_i (T_melt - T_i) + f_i (T_ambient - T_i)
          + r_i (T_melt⁴ - T_i⁴) + e_i (T_ambient⁴ - T_i⁴) - Σ_j R_ij T_j⁴

K is the Laplacian of the conductances between nodes, R that of radiation between them, which only a hollow body has.
Without it radiation leaves a node towards melt and surroundings, and the nonlinear part of the Jacobian is diagonal.
"""

# ruff: noqa: N802, N815 - units keep their capitals: K, W, degC
import functools
import itertools
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import scipy.sparse

from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.closed_chain import IndexArray


@dataclass(frozen=True)
class EnergyBalance:
    """Heat flows of a whole network, in W.

    Attributes:
        melt_conduction_W: from the melt by contact; ``melt_radiation_W`` by radiation, net.
        ambient_film_W: to the surroundings by convection; ``ambient_radiation_W`` by radiation, net.
        stored_W: what is left and warms the nodes; zero in the steady state.
    """

    melt_conduction_W: float
    melt_radiation_W: float
    ambient_film_W: float
    ambient_radiation_W: float

    @property
    def stored_W(self) -> float:
        """Heat in minus heat out, in W."""
        out = self.ambient_film_W + self.ambient_radiation_W
        return self.melt_conduction_W + self.melt_radiation_W - out

    @property
    def relative_error(self) -> float:
        """What a steady state leaves unbalanced, as a share of the heat that passes through."""
        flows = (self.melt_conduction_W, self.melt_radiation_W, self.ambient_film_W, self.ambient_radiation_W)
        through = sum(abs(flow) for flow in flows) / 2.0
        return abs(self.stored_W) / through if through > 0.0 else 0.0


@dataclass(frozen=True, eq=False)
class Circuit:
    """The network as numbers. Shapes: n nodes.

    Attributes:
        laplacian: conductances between nodes, shape (n, n), in W/K; symmetric, rows sum to zero.
        melt_contact: conductance to the melt, shape (n,), in W/K.
        film: conductance to the surroundings, shape (n,), in W/K.
        melt_radiation: emissivities times area times view factor times Stefan's constant, shape (n,), in W/K⁴.
        ambient_radiation: the same to the surroundings, shape (n,), in W/K⁴.
        capacity: shape (n,), in J/K.
        radiating: radiation between nodes, shape (n, n), in W/K⁴, on the pattern of a Laplacian; None: there is none.
    """

    laplacian: FloatArray
    melt_contact: FloatArray
    film: FloatArray
    melt_radiation: FloatArray
    ambient_radiation: FloatArray
    capacity: FloatArray
    radiating: scipy.sparse.csc_array | None = None

    @property
    def nodes(self) -> int:
        """Number of nodes."""
        return len(self.capacity)

    def heat(self, temperatures_K: FloatArray, melt_K: float, ambient_K: float) -> FloatArray:
        """Return the heat flow into every node, shape (n,), in W."""
        t = temperatures_K
        return np.asarray(
            self.melt_contact * (melt_K - t)
            + self.film * (ambient_K - t)
            + self.melt_radiation * (melt_K**4 - t**4)
            + self.ambient_radiation * (ambient_K**4 - t**4)
            - self._sparse_laplacian @ t
            - (0.0 if self.radiating is None else self.radiating @ t**4)
        )

    def jacobian_diagonal(self, temperatures_K: FloatArray) -> FloatArray:
        """Return what the diagonal of d heat / d temperature has besides the Laplacian's, shape (n,), in W/K."""
        radiation = 4.0 * (self.melt_radiation + self.ambient_radiation) * temperatures_K**3
        return np.asarray(-(self.melt_contact + self.film + radiation))

    def jacobian(self, temperatures_K: FloatArray) -> scipy.sparse.csc_array:
        """Return d heat / d temperature, shape (n, n), in W/K; sparse; without ``radiating`` symmetric and definite.

        Sparse for speed: a dense factorisation of this size is slower, and much slower where several threads of a
        linear-algebra library get into each other's way.
        """
        matrix = -self._sparse_laplacian
        matrix.data[self._diagonal_places] += self.jacobian_diagonal(temperatures_K)
        if self.radiating is None:
            return matrix
        return (matrix - self.radiating @ scipy.sparse.diags_array(4.0 * temperatures_K**3)).tocsc()

    @functools.cached_property
    def _sparse_laplacian(self) -> scipy.sparse.csc_array:
        """The Laplacian by columns, its diagonal stored even where it is zero."""
        stored = self.laplacian != 0.0  # symmetric: rows are columns
        np.fill_diagonal(stored, True)
        places = np.flatnonzero(stored)
        starts = np.searchsorted(places, self.nodes * np.arange(self.nodes + 1))
        values, rows = self.laplacian.ravel()[places], places % self.nodes
        return scipy.sparse.csc_array((values, rows, starts), shape=self.laplacian.shape)

    @functools.cached_property
    def _diagonal_places(self) -> IndexArray:
        """Where the diagonal stands in the sparse Laplacian's data, shape (n,)."""
        matrix = self._sparse_laplacian
        columns = np.repeat(np.arange(self.nodes), np.diff(matrix.indptr))
        return np.flatnonzero(matrix.indices == columns)

    def balance(self, temperatures_K: FloatArray, melt_K: float, ambient_K: float) -> EnergyBalance:
        """Return the heat flows of the whole network.

        Args:
            temperatures_K: shape (n,).
            melt_K: temperature of the melt.
            ambient_K: temperature of the surroundings.
        """
        t = temperatures_K
        return EnergyBalance(
            melt_conduction_W=float(self.melt_contact @ (melt_K - t)),
            melt_radiation_W=float(self.melt_radiation @ (melt_K**4 - t**4)),
            ambient_film_W=float(self.film @ (t - ambient_K)),
            ambient_radiation_W=float(self.ambient_radiation @ (t**4 - ambient_K**4)),
        )


def chain_links(nodes: IndexArray, conductance: float) -> list[tuple[int, int, float]]:
    """Return links of equal conductance (W/K) from each node to the next."""
    return [(int(a), int(b), conductance) for a, b in itertools.pairwise(nodes)]


def laplacian(count: int, links: Iterable[tuple[int, int, float]]) -> FloatArray:
    """Return the Laplacian of conductances between nodes.

    Args:
        count: number of nodes n.
        links: first node, second node, conductance in W/K.

    Returns:
        Shape (n, n), in W/K.
    """
    matrix = np.zeros((count, count))
    for first, second, conductance in links:
        matrix[first, first] += conductance
        matrix[second, second] += conductance
        matrix[first, second] -= conductance
        matrix[second, first] -= conductance
    return matrix
