"""A network of lumped temperatures: nodes, conduction between them, films and radiation to melt and surroundings.

Heat flow into node i, in W, with temperatures in K:

    Q_i = -Σ_j K_ij T_j + m_i (T_melt - T_i) + f_i (T_ambient - T_i)
          + r_i (T_melt⁴ - T_i⁴) + e_i (T_ambient⁴ - T_i⁴) - Σ_j R_ij T_j⁴

K is the Laplacian of the conductances between nodes, R that of radiation between nodes, which only hollow bodies have.
Without R, nodes radiate only to melt and surroundings, and the nonlinear part of the Jacobian is diagonal.

Over time C_i dT_i/dt = Q_i(T, t). Capacities span four decades (cladding surface to fixed platform) and re-radiation is
steep, so the system is stiff; it is solved by SciPy's stiff solvers with the analytic Jacobian.
"""

import functools
import itertools
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse
import scipy.sparse.linalg
from scipy.constants import Stefan_Boltzmann
from scipy.integrate import solve_ivp

from pouring_robot.exceptions import ThermalSolutionError
from pouring_robot.io.threads import one_blas_thread
from pouring_robot.mechanism.arrays import FloatArray, Indices
from pouring_robot.thermal.network.history import HeatHistory

STEP_TOLERANCE_K = 1e-4
"""Newton ends after a step s shorter than this. The remaining error is s² times half of curvature over slope of the
heat flows, at most 12 T² / (2 · 4 T³) = 1.5/T, or with reused factors at most a hundredth of s: it is below 1e-6 K."""
# After a step shorter than this the next one reuses the matrix factors: they are off by 3/T of it, a hundredth.
_FACTORS_KEPT_K = 1.0
_MAX_ITERATIONS = 60
SOLVER: dict[str, Any] = {"method": "BDF", "rtol": 1e-6, "atol": 1e-4}
"""Accuracy of integration over time: settings of ``scipy.integrate.solve_ivp``; tolerances, here in K, are per step."""


@dataclass(frozen=True)
class EnergyBalance:
    """Net heat flows of a whole network, in W: from the melt by contact and radiation, to the surroundings."""

    melt_conduction_W: float
    melt_radiation_W: float
    ambient_film_W: float
    ambient_radiation_W: float

    @property
    def stored_W(self) -> float:
        """Heat in minus heat out, stored in the nodes; zero in the steady state."""
        return self.melt_conduction_W + self.melt_radiation_W - (self.ambient_film_W + self.ambient_radiation_W)


@dataclass(frozen=True, eq=False)
class Circuit:
    """Coefficients of the network with n nodes."""

    laplacian: FloatArray  # conductances between nodes, shape (n, n), in W/K; symmetric, rows sum to zero
    melt_contact: FloatArray  # conductance to the melt, shape (n,), in W/K
    film: FloatArray  # conductance to the surroundings, shape (n,), in W/K
    melt_radiation: FloatArray  # emissivities times area times view factor times Stefan's constant, shape (n,), in W/K⁴
    ambient_radiation: FloatArray  # the same to the surroundings, shape (n,), in W/K⁴
    capacity: FloatArray  # shape (n,), in J/K
    # radiation between nodes, shape (n, n), in W/K⁴, in the form of a Laplacian; None: no such radiation
    radiating: scipy.sparse.csc_array | None = None

    @property
    def nodes(self) -> int:
        """Number of nodes."""
        return len(self.capacity)

    @functools.cached_property
    def _sparse(self) -> scipy.sparse.csc_array:
        return scipy.sparse.csc_array(self.laplacian)

    def _flows(self, t: FloatArray, melt_K: float, ambient_K: float) -> tuple[FloatArray, ...]:
        """Return heat flows into nodes, (n,) each, in W: by contact with the melt, by films, by radiation of both."""
        radiation = self.melt_radiation * (melt_K**4 - t**4), self.ambient_radiation * (ambient_K**4 - t**4)
        return self.melt_contact * (melt_K - t), self.film * (ambient_K - t), *radiation

    def heat(self, temperatures_K: FloatArray, melt_K: float, ambient_K: float) -> FloatArray:
        """Return the heat flow into every node, shape (n,), in W."""
        t = temperatures_K
        between = 0.0 if self.radiating is None else self.radiating @ t**4
        return np.asarray(sum(self._flows(t, melt_K, ambient_K)) - self._sparse @ t - between)

    def jacobian(self, temperatures_K: FloatArray) -> scipy.sparse.csc_array:
        """Return d heat / d temperature, shape (n, n), in W/K; sparse; without ``radiating`` symmetric and definite.

        It is sparse for speed: a dense factorisation of this size is slower, and much slower where several threads of a
        linear-algebra library compete.
        """
        radiation = 4.0 * (self.melt_radiation + self.ambient_radiation) * temperatures_K**3
        matrix = -self._sparse
        matrix.setdiag(matrix.diagonal() - (self.melt_contact + self.film + radiation))
        if self.radiating is None:
            return matrix
        return (matrix - self.radiating @ scipy.sparse.diags_array(4.0 * temperatures_K**3)).tocsc()

    def balance(self, temperatures_K: FloatArray, melt_K: float, ambient_K: float) -> EnergyBalance:
        """Return the heat flows of the whole network at given temperatures of its nodes, shape (n,)."""
        contact, film, melt, ambient = (float(flow.sum()) for flow in self._flows(temperatures_K, melt_K, ambient_K))
        return EnergyBalance(contact, melt, -film, -ambient)


def chain_links(nodes: Indices, conductance: float) -> list[tuple[int, int, float]]:
    """Return links of equal conductance (W/K) from each node to the next."""
    return [(int(a), int(b), conductance) for a, b in itertools.pairwise(nodes)]


def laplacian(count: int, links: Iterable[tuple[int, int, float]]) -> FloatArray:
    """Return the Laplacian, shape (count, count), of links: first node, second node, conductance in W/K."""
    matrix = np.zeros((count, count))
    for first, second, conductance in links:
        matrix[[first, second], [first, second]] += conductance
        matrix[[first, second], [second, first]] -= conductance
    return matrix


def grey_radiation(
    area_m2: FloatArray, view_area_m2: FloatArray, emissivity: FloatArray | float, melt_emissivity: float
) -> tuple[FloatArray, FloatArray]:
    """Return radiation coefficients of surfaces with melt and surroundings, from area and area times view factor, (n,).

    Surfaces are grey and diffuse; the view factors are small enough to neglect multiple reflections. The melt's surface
    emits and absorbs the share ``melt_emissivity`` and reflects the surroundings with the rest, so that no heat flows
    in surroundings as hot as the melt. Shape (n,) each, in W/K⁴.
    """
    melt_area_m2 = melt_emissivity * view_area_m2
    scale = emissivity * Stefan_Boltzmann
    return scale * melt_area_m2, scale * (area_m2 - melt_area_m2)


@one_blas_thread()
def steady_temperatures(
    circuit: Circuit, melt_K: float, ambient_K: float, near: FloatArray | None = None
) -> FloatArray:
    """Return the temperatures at which the heat flow into every node is zero, (n,), in K; ``near``: a start, (n,).

    The negative Jacobian is an M-matrix and every heat flow is concave in the temperatures. So Newton's method, started
    above the solution, descends to it without ever passing it. Nothing is hotter than the hotter of melt and
    surroundings, so that is the default start (convergence: Ortega and Rheinboldt, monotone Newton theorem). From any
    other start the first step leads above the solution, so temperatures at a nearby pose are a valid and better start.
    Raises ThermalSolutionError where a part has no path to melt or surroundings, or Newton does not converge.
    """
    temperatures = np.full(circuit.nodes, max(melt_K, ambient_K)) if near is None else near
    longest = np.inf
    for _ in range(_MAX_ITERATIONS):
        heat = circuit.heat(temperatures, melt_K, ambient_K)
        if longest > _FACTORS_KEPT_K:
            try:
                factors = scipy.sparse.linalg.splu(
                    circuit.jacobian(temperatures), permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True}
                )
            except RuntimeError as error:  # exactly singular
                raise ThermalSolutionError("a part is connected to nothing that takes its heat") from error
        step = -factors.solve(heat)
        temperatures = temperatures + step
        if not np.isfinite(temperatures).all():
            break
        longest = float(np.abs(step).max())
        if longest < STEP_TOLERANCE_K:
            return np.asarray(temperatures)
    raise ThermalSolutionError(f"Newton's steps do not settle in {_MAX_ITERATIONS} iterations")


def integrate(
    circuit: Circuit,
    history: HeatHistory,
    span_s: tuple[float, float],
    state: FloatArray,
    times_s: FloatArray,
    solver: Mapping[str, Any] = SOLVER,
) -> tuple[list[FloatArray], FloatArray]:
    """Integrate temperatures, (n,), in K, over a smooth segment; return them at its times and at its end.

    Raises:
        ThermalSolutionError: the integrator fails.
    """
    inverse = 1.0 / circuit.capacity
    scale = scipy.sparse.diags_array(inverse).tocsc()

    def slope(time: float, temperatures: FloatArray) -> FloatArray:
        return np.asarray(inverse * circuit.heat(temperatures, *history.at(time)))

    def jacobian(_time: float, temperatures: FloatArray) -> scipy.sparse.csc_matrix:
        return scipy.sparse.csc_matrix(scale @ circuit.jacobian(temperatures))

    report = np.append(times_s[times_s < span_s[1]], span_s[1])
    with np.errstate(over="ignore", invalid="ignore"):  # BDF also subtracts memory that it never uses
        solution = solve_ivp(slope, span_s, state, t_eval=report, jac=jacobian, **solver)
    if not solution.success:
        raise ThermalSolutionError(f"{solver['method']} gives up at {solution.t[-1]:g} s: {solution.message}")
    states = [np.array(column) for column in solution.y.T]
    return states if times_s.size == report.size else states[:-1], states[-1]
