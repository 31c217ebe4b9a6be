"""``pouring-robot robots``: what is loaded."""

from __future__ import annotations

from typing import Any

from pouring_robot.cli import options
from pouring_robot.layout import layout_names
from pouring_robot.model import RobotModel
from pouring_robot.poses import MM, PlatformPose
from pouring_robot.robot import PouringRobot


def robot_figures(robot: PouringRobot) -> dict[str, Any]:
    """Return what is known of a robot at the middle of its workspace, ready for JSON."""
    layout, mechanism = robot.layout, robot.actual_solver.mechanism
    middle = 0.5 * (layout.position_lower_m + layout.position_upper_m)
    tilt = 0.5 * (layout.tilt_lower_rad + layout.tilt_upper_rad)
    location = robot.locate(PlatformPose((float(middle[0]), float(middle[1]), float(middle[2])), tilt))
    limits = mechanism.joint_limits()
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
            name: {
                "lower": limits[name][0],
                "upper": limits[name][1],
                "unit": mechanism.unit_of(name),
            }
            for name in mechanism.loops.drives
        },
        "displaced_joints": sorted(robot.model.joint_placements),
        "workspace": {
            "position_lower_mm": (layout.position_lower_m / MM).tolist(),
            "position_upper_mm": (layout.position_upper_m / MM).tolist(),
            "tilt_rad": [layout.tilt_lower_rad, layout.tilt_upper_rad],
        },
    }


def robots(model: options.ModelFile = None, layout: options.LayoutName = None, as_json: options.AsJson = False) -> None:
    """List the robots that are loaded: freedoms, rank, drives, workspace."""
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
        workspace, low, high = (
            robot["workspace"],
            *(robot["workspace"][f"position_{k}_mm"] for k in ("lower", "upper")),
        )
        box = ", ".join(f"{axis} {a:g} … {b:g}" for axis, a, b in zip("xyz", low, high, strict=True))
        console.print(
            f"{robot['layout']}: {robot['mechanism']}, {robot['bodies']} bodies, {robot['mass_kg']:.0f} kg\n"
            f"  {robot['joints']} chain joints, {robot['equations']} closure equations of rank "
            f"{robot['rank_nominal']}: {robot['freedoms']} freedoms "
            f"({robot['equations'] - robot['rank_nominal']} equations redundant)"
        )
        if robot["displaced_joints"]:
            console.print(f"  as built: {len(robot['displaced_joints'])} joints displaced, rank {robot['rank_actual']}")
        for name, drive in robot["drives"].items():
            console.print(f"  drive {name}: {drive['lower']:g} … {drive['upper']:g} {drive['unit']}")
        tilt = workspace["tilt_rad"]
        console.print(f"  workspace: {box} mm, tilt {tilt[0]:g} … {tilt[1]:g} rad")
