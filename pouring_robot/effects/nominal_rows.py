"""What the drawing predicts for the rows of a campaign: poses, how drives move them, forces of weight on drives."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from pouring_robot.batch import BatchClosure, Engine, seen_from_rest
from pouring_robot.campaign.metadata import CampaignMetadata
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.closed_chain import ClosedChainMechanism
from pouring_robot.mechanism.gravity import GRAVITY_M_S2
from pouring_robot.mechanism.local_parameters import drive_parameters
from pouring_robot.mechanism.weight_on_joints import force_per_newton, own_force, own_moments, up_in_base
from pouring_robot.robot.description.definition import RobotDefinition
from pouring_robot.robot.effect_stack import LearnedCampaign


@dataclass(frozen=True, eq=False)
class NominalRows:
    """What the drawing predicts for the rows of a campaign."""

    robot: RobotDefinition  # the drawing
    position_m: FloatArray  # origin of the end body in the base, (n, 3)
    rotation: FloatArray  # its axes, (n, 3, 3)
    rotation_at_rest: FloatArray  # in a frame in which weight pulls one way (``seen_from_rest``), as all that follows
    by_drive: FloatArray  # ∂pose/∂drive, (n, 6, D)
    turns: tuple[str, ...]  # T local parameters that turn joints
    by_turn: FloatArray  # ∂pose/∂turn, (n, 6, T)
    up: FloatArray  # direction against gravity, (3,)
    swing_rad: FloatArray  # of the joint about which each drive's chain swings, (n, D); NaN without one
    own_force: FloatArray | None  # of the links' weight on each drive, (n, D); None: not counted, or no inertias drawn
    own_moment: FloatArray | None  # and on each turn, (n, T); None in closed loops, too
    slides_m: Mapping[str, FloatArray]  # values of sliding joints, (n,)
    payload_m: FloatArray | None  # of the payload on the end body, (3,); None where the campaign states it, with a tare


def nominal_rows(robot: RobotDefinition, engine: Engine, closure: BatchClosure) -> NominalRows:
    """Return what the drawing predicts for rows that its engine, without errors, closed, all of them."""
    mechanism = engine.structure.mechanism
    drives = drive_parameters(mechanism)
    joints = engine.structure.placed_joints
    turns = [turn for turn in engine.parameters if turn.unit == "rad"]
    rest, lifted = seen_from_rest(engine, closure)
    moved = rest.transfer(lifted, (*drives, *turns)).matrix
    values = engine.structure.joint_values(closure.joints)
    own = robot.own_weight
    weighs = own and any(inertia.mass > 0.0 for inertia in [*mechanism.shared_model.inertias][1:])  # else none is drawn
    configurations = engine.structure.configurations(closure.joints) if own else closure.joints
    return NominalRows(
        robot,
        closure.position,
        closure.rotation,
        lifted.rotation,
        moved[:, :, : len(drives)],
        tuple(turn.name for turn in turns),
        moved[:, :, len(drives) :],
        up_in_base(rest.structure.mechanism),
        _swings(mechanism, values, len(closure)),
        own_force(mechanism, configurations) if weighs else None,
        own_moments(mechanism, configurations, joints) if weighs and not mechanism.anchors else None,
        {name: course for name, course in values.items() if name in joints and mechanism.unit_of(name) == "m"},
        mechanism.placement_on_end(robot.payload_frame).translation if own else None,
    )


def loads_on(
    nominal: NominalRows, facts: CampaignMetadata | LearnedCampaign, payload_kg: FloatArray | None
) -> tuple[FloatArray | None, FloatArray | None, FloatArray | None, Mapping[str, FloatArray] | None]:
    """Return the weight carried, (n,), the forces of it and of the links on every drive, and those per newton of it.

    Last, the moments of both on joints, by the local parameter that turns them.
    """
    own = None if nominal.own_moment is None else dict(zip(nominal.turns, nominal.own_moment.T, strict=True))
    tare, place = facts.ladle_tare_kg, facts.ladle_centre_of_mass_m
    if nominal.payload_m is not None:
        tare, place = 0.0, tuple(nominal.payload_m)  # what the end body weighs is among its links
    if place is None:
        return None, nominal.own_force, None, own
    share = force_per_newton(nominal.up, nominal.by_drive, nominal.rotation_at_rest, place)
    if tare is None or payload_kg is None:
        return None, nominal.own_force, share, own
    weight = (tare + payload_kg) * GRAVITY_M_S2
    force = weight[:, None] * share
    carried = (weight[:, None] * force_per_newton(nominal.up, nominal.by_turn, nominal.rotation_at_rest, place)).T
    moments = {n: moment + (own[n] if own else 0.0) for n, moment in zip(nominal.turns, carried, strict=True)}
    return weight, force if nominal.own_force is None else force + nominal.own_force, share, moments


def _swings(mechanism: ClosedChainMechanism, values: dict[str, FloatArray], rows: int) -> FloatArray:
    """Return the angle of the first turning joint before each sliding drive that no drive moves, (n, D)."""
    drives, paths = mechanism.loops.drives, mechanism.frame_paths
    held = {*drives, *mechanism.loops.locked_joints}
    found = np.full((rows, len(drives)), np.nan)
    for k, drive in enumerate(drives):
        if mechanism.unit_of(drive) == "m":
            before = [j for j in paths[drive] if j in values and j not in held and mechanism.unit_of(j) == "rad"]
            found[:, k] = values[before[0]] if before else np.nan
    return found
