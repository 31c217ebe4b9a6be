"""``pouring-robot robots``: the loaded robots and their properties."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Literal

from pouring_robot.cli.shared import bundles, options
from pouring_robot.io.units import MM, joint_shown_in

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from pouring_robot.robot.location import Location
    from pouring_robot.robot.robot import Robot


def robot_figures(robot: Robot) -> dict[str, Any]:
    """Return the properties of a robot, ready for JSON: in the middle of its workspace, or at its home."""
    from pouring_robot.robot.pouring_robot import PouringRobot

    mechanism, loops = robot.actual_solver.mechanism, robot.actual_solver.mechanism.loops
    model, limits = mechanism.shared_model, mechanism.joint_limits()
    location = robot.location_in_the_middle()
    figures: dict[str, Any] = {
        **robot.model.named,
        "mechanism": loops.mechanism,
        "bodies": int(model.nbodies) - 1,
        "mass_kg": float(sum(inertia.mass for inertia in list(model.inertias)[1:])),
        "joints": int(mechanism.closing_columns.size) - 6 * len(loops.cut_joints),
        "loops": list(loops.names),
        "equations": sum(6 if loop.type == "6d" else 3 for loop in loops.loops),
        "rank_nominal": location.nominal.rank,
        "rank_actual": location.actual.rank,
        "freedoms": location.nominal.freedoms,
        "pose_determined": _determined(robot, location),
        "drives_beyond_freedoms": 0 if loops.redundant_drives else len(loops.drives) - location.nominal.freedoms,
        "drives": {
            name: _at_the_edge(limits.get(name, (-math.inf, math.inf)), mechanism.unit_of(name))
            for name in loops.drives
        },
        "campaign_columns": {drive.joint: drive.column for drive in robot.model.definition.drives},
        "displaced_joints": sorted(robot.model.joint_placements),
        "unseen_displacements": list(robot.unseen_displacements),
        "idle_drives": list(robot.idle_drives),
    }
    if isinstance(robot, PouringRobot):
        lower, upper = robot.layout.box
        figures["workspace"] = {
            "position_lower_mm": _rounded(lower[:3] / MM),
            "position_upper_mm": _rounded(upper[:3] / MM),
            "tilt": _at_the_edge((lower[3], upper[3]), "rad"),
        }
    return figures


def _determined(robot: Robot, location: Location) -> bool:
    """Return whether the drives determine the nominal pose at a location."""
    from pouring_robot.exceptions import SingularPoseError
    from pouring_robot.mechanism.local_parameters import drive_parameters
    from pouring_robot.mechanism.transfer import closed_chain_transfer

    try:
        closed_chain_transfer(robot.nominal_solver, location.nominal, drive_parameters(robot.nominal_solver.mechanism))
    except SingularPoseError:
        return False
    return True


def _at_the_edge(limits: tuple[float, float], unit: Literal["m", "rad"]) -> dict[str, Any]:
    """Return limits in m or rad converted to mm or degrees."""
    shown, size = joint_shown_in(unit)
    lower, upper = (_rounded([limit / size])[0] if math.isfinite(limit) else None for limit in limits)
    return {"lower": lower, "upper": upper, "unit": shown}


def _rounded(values: Iterable[float]) -> list[float]:
    """Return mm or degrees without rounding errors from the conversion: -825, not -824.9999999999999."""
    return [round(float(value), 9) + 0.0 for value in values]


def robots(*, which: bundles.RobotOptions, as_json: options.AsJson = False) -> None:
    """List the robots: degrees of freedom, rank, drives, workspace."""
    from pouring_robot.robot.model import RobotModel
    from pouring_robot.robot.pouring.layout import layout_names
    from pouring_robot.robot.pouring_robot import robot_of

    named = which != bundles.RobotOptions()
    chosen = [which.built()] if named else [robot_of(RobotModel(layout=name)) for name in layout_names()]
    figures = [robot_figures(one) for one in chosen]
    if as_json:
        return options.print_json(figures)
    for found, one in zip(figures, chosen, strict=True):
        geared = {d.joint: d.command for d in one.model.definition.drives if (d.factor, d.zero) != (1.0, 0.0)}
        _print(found, geared)


def _print(robot: dict[str, Any], geared: Mapping[str, Literal["length", "angle"]]) -> None:
    """Print the properties of a robot; for drives whose command is not their joint's value, also the command."""
    from pouring_robot.cli.shared.locations import unseen_note

    joints = f"{robot['joints']} {'chain ' if robot['loops'] else ''}joints"
    closures = (
        f"{robot['equations']} closure equations of rank {robot['rank_nominal']}" if robot["loops"] else "no loops"
    )
    redundant = f" ({robot['equations'] - robot['rank_nominal']} equations redundant)" if robot["loops"] else ""
    mass = robot["mass_kg"]
    weight = f"{robot['bodies']} bodies, {mass:.{0 if mass >= 1.0 else 2}f} kg" if mass else "no masses"
    options.say(f"{robot.get('layout') or robot['robot']}: {robot['mechanism']}, {weight}")
    options.print_indented(f"{joints}, {closures}: {robot['freedoms']} freedoms{redundant}")
    if not robot["pose_determined"]:
        options.print_indented(
            "the drives do not determine the pose: list every driven joint, or choose another home if this "
            "one is singular"
        )
    elif robot["drives_beyond_freedoms"] > 0:
        options.print_indented(
            "more drives than freedoms: remove from locked_joints what the loops move, from drives what only follows"
        )
    if robot["displaced_joints"]:
        options.print_indented(
            f"as built: {len(robot['displaced_joints'])} joints displaced, rank {robot['rank_actual']}"
        )
    for joint in robot["unseen_displacements"]:
        options.print_indented(unseen_note(joint))
    for name, drive in robot["drives"].items():
        edges = [f"{edge:.6g}" if edge is not None else "any" for edge in (drive["lower"], drive["upper"])]
        column = robot["campaign_columns"][name]
        called = "" if column == name else f"; {column} in campaigns"
        if command := geared.get(name):
            unit, said = ("mm", "its command") if command == "length" else ("deg", "the angle of its motor")
            called = f"; {column}_{unit} in campaigns, {said}"
        idle = "; moves nothing between base and end body" if name in robot["idle_drives"] else ""
        options.print_indented(f"drive {name}: {' … '.join(edges)} {drive['unit']}{called}{idle}")
    if workspace := robot.get("workspace"):
        limits = zip("xyz", workspace["position_lower_mm"], workspace["position_upper_mm"], strict=True)
        box = ", ".join(f"{axis} {low:g} … {high:g}" for axis, low, high in limits)
        tilt = workspace["tilt"]
        options.print_indented(f"workspace: {box} mm, tilt {tilt['lower']:.6g} … {tilt['upper']:.6g} {tilt['unit']}")
