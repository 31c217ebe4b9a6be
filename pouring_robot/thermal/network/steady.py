"""Steady temperatures of a network: Newton with the analytic Jacobian.

The negative Jacobian is an M-matrix and every heat flow is concave in the temperatures, so Newton from a start above
the solution comes down to it without ever passing it; nothing is hotter than the hotter of melt and surroundings, so
that is the start (convergence: Ortega and Rheinboldt, monotone Newton theorem). From anywhere else the first step leads
above the solution, so that temperatures of a pose nearby are a start too, and a better one.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse.linalg

from pouring_robot.exceptions import ThermalSolutionError
from pouring_robot.io.threads import one_blas_thread
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.thermal.network.circuit import Circuit

STEP_TOLERANCE_K = 1e-7
"""Newton ends after a step shorter than this; what is left is its square, times a factor far below one."""
_MAX_ITERATIONS = 60


@one_blas_thread()
def steady_temperatures(
    circuit: Circuit, melt_K: float, ambient_K: float, near: FloatArray | None = None
) -> FloatArray:
    """Return the temperatures at which every node gives off what it takes up.

    Args:
        circuit: the network, n nodes.
        melt_K: temperature of the melt.
        ambient_K: temperature of the surroundings.
        near: temperatures to start from, shape (n,), in K.

    Returns:
        Shape (n,), in K.

    Raises:
        ThermalSolutionError: a part of the network has no way to melt or surroundings, or Newton does not settle.
    """
    temperatures = np.full(circuit.nodes, max(melt_K, ambient_K)) if near is None else near
    for _ in range(_MAX_ITERATIONS):
        heat = circuit.heat(temperatures, melt_K, ambient_K)
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
        if np.abs(step).max() < STEP_TOLERANCE_K:
            return np.asarray(temperatures)
    raise ThermalSolutionError(f"Newton's steps do not settle in {_MAX_ITERATIONS} iterations")
