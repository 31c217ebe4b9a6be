"""``pouring-robot robots``: what is loaded."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Literal

from pouring_robot.cli.shared import options

if TYPE_CHECKING:
    from collections.abc import Iterable

    from pouring_robot.robot.robot import PouringRobot


def robot_figures(robot: PouringRobot) -> dict[str, Any]:
    """Return what is known of a robot at the middle of its workspace, ready for JSON."""
    from pouring_robot.mechanism.poses import MM
    from pouring_robot.robot.pouring.poses import PlatformPose

    layout, mechanism = robot.layout, robot.actual_solver.mechanism
    middle = 0.5 * (layout.position_lower_m + layout.position_upper_m)
    tilt = 0.5 * (layout.tilt_lower_rad + layout.tilt_upper_rad)
    location = robot.locate(PlatformPose((float(middle[0]), float(middle[1]), float(middle[2])), tilt))
    model = mechanism.shared_model
    return {
        "layout": robot.model.layout,
        "mechanism": mechanism.loops.mechanism,
        "bodies": int(model.nbodies) - 1,
        "mass_kg": float(sum(inertia.mass for inertia in list(model.inertias)[1:])),
        "joints": int(mechanism.closing_columns.size) - 6 * len(mechanism.loops.cut_joints),
        "loops": list(mechanism.loops.names),
        "equations": 6 * len(mechanism.loops.loops),
        "rank_nominal": location.nominal.rank,
        "rank_actual": location.actual.rank,
        "freedoms": location.nominal.freedoms,
        "drives": {
            name: _at_the_edge(mechanism.joint_limits()[name], mechanism.unit_of(name))
            for name in mechanism.loops.drives
        },
        "displaced_joints": sorted(robot.model.joint_placements),
        "unseen_displacements": list(robot.unseen_displacements),
        "workspace": {
            "position_lower_mm": _rounded(layout.position_lower_m / MM),
            "position_upper_mm": _rounded(layout.position_upper_m / MM),
            "tilt": _at_the_edge((layout.tilt_lower_rad, layout.tilt_upper_rad), "rad"),
        },
    }


def _at_the_edge(limits: tuple[float, float], unit: Literal["m", "rad"]) -> dict[str, Any]:
    """Return limits given in m or rad in mm or degrees."""
    shown, factor = ("mm", 1e3) if unit == "m" else ("deg", math.degrees(1.0))
    lower, upper = _rounded(limit * factor for limit in limits)
    return {"lower": lower, "upper": upper, "unit": shown}


def _rounded(values: Iterable[float]) -> list[float]:
    """Return mm or degrees without the digits that only the change of unit made: -825, not -824.9999999999999."""
    return [round(float(value), 9) + 0.0 for value in values]


def robots(model: options.ModelFile = None, layout: options.LayoutName = None, as_json: options.AsJson = False) -> None:
    """List the robots that are loaded: freedoms, rank, drives, workspace."""
    from pouring_robot.cli.shared.locations import unseen_note
    from pouring_robot.robot.model import RobotModel
    from pouring_robot.robot.pouring.layout import layout_names
    from pouring_robot.robot.robot import PouringRobot

    if model is not None or layout is not None:
        loaded = [options.robot_of(model, layout)]
    else:
        loaded = [PouringRobot(RobotModel(layout=name)) for name in layout_names()]
    figures = [robot_figures(robot) for robot in loaded]
    if as_json:
        options.print_json(figures)
        return
    console = options.console()
    for robot in figures:
        workspace = robot["workspace"]
        limits = zip("xyz", workspace["position_lower_mm"], workspace["position_upper_mm"], strict=True)
        box = ", ".join(f"{axis} {low:g} … {high:g}" for axis, low, high in limits)
        console.print(
            f"{robot['layout']}: {robot['mechanism']}, {robot['bodies']} bodies, {robot['mass_kg']:.0f} kg\n"
            f"  {robot['joints']} chain joints, {robot['equations']} closure equations of rank "
            f"{robot['rank_nominal']}: {robot['freedoms']} freedoms "
            f"({robot['equations'] - robot['rank_nominal']} equations redundant)"
        )
        if robot["displaced_joints"]:
            console.print(f"  as built: {len(robot['displaced_joints'])} joints displaced, rank {robot['rank_actual']}")
        for joint in robot["unseen_displacements"]:
            console.print(f"  {unseen_note(joint)}")
        for name, drive in robot["drives"].items():
            console.print(f"  drive {name}: {drive['lower']:.6g} … {drive['upper']:.6g} {drive['unit']}")
        tilt = workspace["tilt"]
        console.print(f"  workspace: {box} mm, tilt {tilt['lower']:.6g} … {tilt['upper']:.6g} {tilt['unit']}")
