"""Steady temperatures of a network: Newton with the analytic Jacobian.

The negative Jacobian is an M-matrix and every heat flow is concave in the temperatures, so Newton from a start above
the solution comes down to it without ever passing it; nothing is hotter than the hotter of melt and surroundings, so
that is the start (convergence: Ortega and Rheinboldt, monotone Newton theorem). From anywhere else the first step leads
above the solution, so that temperatures of a pose nearby are a start too, and a better one.
"""

import numpy as np
import scipy.sparse.linalg

from pouring_robot.exceptions import ThermalSolutionError
from pouring_robot.io.threads import one_blas_thread
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.thermal.network.circuit import Circuit

STEP_TOLERANCE_K = 1e-4
"""Newton ends after a step s shorter than this. What is left is s² times half of curvature over slope of the heat
flows, at most 12 T² / (2 · 4 T³) = 1.5/T, or with factors kept a hundredth of s at most: it is below 1e-6 K."""
# After a step shorter than this the next takes the factors of the last: they are off by 3/T of it, a hundredth.
_FACTORS_KEPT_K = 1.0
_MAX_ITERATIONS = 60


@one_blas_thread()
def steady_temperatures(
    circuit: Circuit, melt_K: float, ambient_K: float, near: FloatArray | None = None
) -> FloatArray:
    """Return the temperatures at which every node gives off what it takes up, and ``near`` to start from: (n,), in K.

    Raises:
        ThermalSolutionError: a part of the network has no way to melt or surroundings, or Newton does not settle.
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
