"""How the temperatures of a network go on in time.

C_i dT_i/dt = Q_i(T, t), with Q of :mod:`pouring_robot.thermal.network.circuit`. Capacities span four decades
(cladding surface to fixed platform) and re-radiation is steep, so the system is stiff: SciPy's stiff solvers with the
analytic Jacobian. Integration restarts where the pose or the slope of a temperature changes; between these points
everything is smooth.
"""

import itertools
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import scipy.sparse
from scipy.integrate import solve_ivp

from pouring_robot.exceptions import HistoryError, ThermalSolutionError
from pouring_robot.io.threads import one_blas_thread
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.thermal.network.assembly import ThermalNetwork
from pouring_robot.thermal.network.circuit import Circuit
from pouring_robot.thermal.network.history import HeatHistory, Placed, PoseSchedule
from pouring_robot.thermal.network.parts import TemperatureField

SOLVER: dict[str, Any] = {"method": "BDF", "rtol": 1e-6, "atol": 1e-4}
"""How exactly time is followed: settings of ``scipy.integrate.solve_ivp``; tolerances, here in K, are per step."""


@one_blas_thread()
def simulate(
    network: ThermalNetwork,
    history: HeatHistory,
    poses: Placed | PoseSchedule | Sequence[tuple[float, Placed]],
    *,
    start: TemperatureField | None = None,
    times_s: FloatArray | None = None,
    solver: Mapping[str, Any] = SOLVER,
) -> tuple[TemperatureField, ...]:
    """Follow the temperatures of a robot's network through a history; return them at times, each at the pose then held.

    ``poses``: one pose held throughout, or entries of time and pose; ``start``: temperatures at the start, by default
    all is as warm as the surroundings; ``times_s``: increasing, within the history, by default its entries.

    Raises:
        HistoryError: a time to report lies outside the history or out of order, or a pose comes after its end.
        ThermalSolutionError: the integrator gives up.
    """
    schedule = PoseSchedule.of(poses, history.start_s)
    for row, (time, _) in enumerate(schedule.entries, start=1):
        if time > history.end_s:
            raise HistoryError(f"a pose starts at {time:g} s, after the history's end at {history.end_s:g} s", row)
    wanted = np.array(history.times_s if times_s is None else times_s, dtype=float)
    if wanted.size == 0 or np.any(np.diff(wanted) <= 0.0):
        raise HistoryError("the times to report must increase")
    if wanted[0] < history.start_s or wanted[-1] > history.end_s:
        span = f"{history.start_s:g} to {history.end_s:g} s"
        raise HistoryError(f"the times to report, {wanted[0]:g} to {wanted[-1]:g} s, leave the history, {span}")
    cold = np.full(network.bodies.nodes.count, history.at(history.start_s)[1])
    state = cold if start is None else start.temperatures_K
    changes = [time for time, _ in schedule.entries if history.start_s < time < history.end_s]
    edges = np.unique(np.concatenate([[history.start_s, history.end_s], history.corners_s, changes]))
    states: list[FloatArray] = []
    for begin, end in itertools.pairwise(edges):
        if not np.any(wanted >= begin):
            break
        # A time at which the pose changes is reported at the new pose: it belongs to the segment that begins there.
        inside = wanted[(wanted >= begin) & ((wanted < end) | (end == edges[-1]))]
        circuit = network.circuit(schedule.at(float(begin)))
        reported, state = integrate(circuit, history, (float(begin), float(end)), state, inside, solver)
        states += reported
    return tuple(
        network.field(schedule.at(float(time)), values, *history.at(float(time)))
        for time, values in zip(wanted, states, strict=True)
    )


def integrate(
    circuit: Circuit,
    history: HeatHistory,
    span_s: tuple[float, float],
    state: FloatArray,
    times_s: FloatArray,
    solver: Mapping[str, Any] = SOLVER,
) -> tuple[list[FloatArray], FloatArray]:
    """Integrate temperatures, (n,), in K, over a smooth stretch; return them at its times and at its end.

    Raises:
        ThermalSolutionError: the integrator gives up.
    """
    inverse = 1.0 / circuit.capacity
    scale = scipy.sparse.diags_array(inverse).tocsc()

    def slope(time: float, temperatures: FloatArray) -> FloatArray:
        return np.asarray(inverse * circuit.heat(temperatures, *history.at(time)))

    def jacobian(_time: float, temperatures: FloatArray) -> scipy.sparse.csc_matrix:
        return scipy.sparse.csc_matrix(scale @ circuit.jacobian(temperatures))

    report = np.append(times_s[times_s < span_s[1]], span_s[1])
    with np.errstate(over="ignore", invalid="ignore"):  # BDF also takes differences of memory that it never reads
        solution = solve_ivp(slope, span_s, state, t_eval=report, jac=jacobian, **solver)
    if not solution.success:
        raise ThermalSolutionError(f"{solver['method']} gives up at {solution.t[-1]:g} s: {solution.message}")
    states = [np.array(column) for column in solution.y.T]
    return states if times_s.size == report.size else states[:-1], states[-1]
