"""Conditions that hold everything an effect may need: to list what the library offers."""

from __future__ import annotations

import numpy as np

from pouring_robot.effects.conditions import Conditions


def complete_conditions(rows: int = 3) -> Conditions:
    """Return plausible conditions of a few rows in one session, nothing missing; figures of no machine."""
    one = np.ones(rows)
    course = np.linspace(0.0, 1.0, rows)
    lengths = np.tile([0.55, 0.55, 0.70, 0.71], (rows, 1)) + 0.05 * course[:, None]
    return Conditions(
        drives=np.column_stack([lengths[:, :3], 0.1 * course]),
        lengths_m=lengths,
        position_m=np.column_stack([-0.1 * one, 0.02 * course, -0.6 - 0.1 * course]),
        rotation=np.tile(np.eye(3), (rows, 1, 1)),
        lean_rad=0.1 * np.ones((rows, 4)),
        lower_centres_m=0.2 * np.array([[-1.0, 1.0, 0.0], [-1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [1.0, -1.0, 0.0]]),
        session=np.zeros(rows, dtype=np.intp),
        time_s=3600.0 * course,
        time_known=True,
        approach=np.ones((rows, 4)),
        weight_n=5000.0 * one,
        leg_pull_n=2000.0 * np.ones((rows, 3)),
        tilt_moment_nm=500.0 * one,
        truss_travel_m=3.0 * course,
        melt_rise_k=1500.0 * one,
        ambient_rise_k=5.0 * one,
        leg_rise_k=50.0 * np.ones((rows, 4)),
        platform_rise_k=80.0 * one,
        screw_pitch_m=0.01,
        truss_span_m=6.0,
    )
