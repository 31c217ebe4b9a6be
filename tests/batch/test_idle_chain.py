"""Chains with internal idle motions, in the engine for stars: pose as of a triangle, G as of the general engine."""

import numpy as np

from pouring_robot.batch import CompiledEngine, GeneralEngine, HomotopyStarts, engine_for
from pouring_robot.mechanism.closure.status import STATUS_NAMES
from pouring_robot.mechanism.local_parameters import drive_parameters
from tests.mechanism.struts import CRANK, GROUND, STROKE, crank_end, strut_star


def home():
    """Return joint values near the closed pose, the rod spun by half a radian."""
    x, z = crank_end(STROKE)
    hinge, lean = np.arctan2(-z, x), np.arctan2(x - GROUND, z)
    return {"hinge": hinge, "stroke": STROKE, "ball1_y": lean, "ball1_z": 0.5, "ball2_z": -0.5, "ball2_y": 0.01}


def test_a_chain_whose_rod_spins_closes_where_the_triangle_says():
    mechanism = strut_star()
    engine = engine_for(mechanism)
    assert isinstance(engine, CompiledEngine)
    drives = np.linspace(0.45, 0.75, 50)[:, None]
    closed = engine.close(drives, HomotopyStarts(engine, home()).starts(drives)).require_all()
    expected = np.array([crank_end(stroke) for stroke in drives[:, 0]])
    np.testing.assert_allclose(closed.position[:, [0, 2]], expected, rtol=0, atol=1e-12)
    np.testing.assert_allclose(np.hypot(*closed.position[:, [0, 2]].T), CRANK, rtol=0, atol=1e-12)


def test_its_transfer_matrix_is_that_of_the_general_engine():
    mechanism = strut_star()
    star, general = CompiledEngine(mechanism), GeneralEngine(mechanism)
    drives, matrices = np.array([[0.55], [0.65]]), []
    parameters = [*general.parameters, *drive_parameters(mechanism)]
    for engine in (star, general):
        closed = engine.close(drives, HomotopyStarts(engine, home()).starts(drives)).require_all()
        found = engine.transfer(closed, parameters)
        assert not found.status.any()
        matrices.append(found.matrix)
    for column, parameter in enumerate(parameters):
        # The spin that is left to chance turns what happens at the rod itself, but not what the crank feels of it.
        if parameter.name.startswith(("hinge", "arm", "rod_seat", "ball1_y", "drive.")):
            np.testing.assert_allclose(matrices[0][..., column], matrices[1][..., column], rtol=0, atol=1e-9)


def test_a_platform_that_nothing_holds_stays_where_the_loops_close():
    """Its Hessian is singular but for round-off, whose sign is chance: none of a hundred starts may feel it."""
    mechanism = strut_star()
    driven = engine_for(mechanism)
    strokes = np.linspace(0.45, 0.75, 100)[:, None]
    start = driven.close(strokes, HomotopyStarts(driven, home()).starts(strokes)).require_all().as_start()
    engine = engine_for(mechanism.with_drives(()))
    assert isinstance(engine, CompiledEngine)
    closed = engine.close(np.zeros((100, 0)), start).require_all()
    np.testing.assert_allclose(closed.position, start.position, rtol=0, atol=1e-9)
    moved = engine.close(np.zeros((100, 0)), driven.close(strokes + 1e-5, start).as_start()).require_all()
    np.testing.assert_allclose(np.hypot(*moved.position[:, [0, 2]].T), CRANK, rtol=0, atol=1e-12)
    assert set(engine.transfer(closed, engine.parameters).status.tolist()) == {STATUS_NAMES.index("singular")}
