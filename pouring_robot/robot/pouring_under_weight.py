"""The robot as built under its weight: legs, joints and tilt drive have the compliance of their parts."""

import copy

import numpy as np
import pinocchio as pin

from pouring_robot.mechanism.closure.energy import Loads
from pouring_robot.mechanism.closure.solver import ClosureSolver
from pouring_robot.mechanism.gravity import GRAVITY_M_S2
from pouring_robot.mechanism.loops_file import AxialStiffness, LoopStiffness, TorsionStiffness
from pouring_robot.robot.pouring.names import STROKES
from pouring_robot.robot.pouring.platform_pose import PlatformPose
from pouring_robot.robot.pouring.stiffness import PartStiffness, StiffnessProperties, beam, load_stiffness
from pouring_robot.robot.pouring_robot import PouringRobot


def stiffness_at(
    robot: PouringRobot, pose: PlatformPose, payload_kg: float, properties: StiffnessProperties | None = None
) -> PartStiffness:
    """Return the stiffness of the parts at a nominal pose; bearings carry a quarter of the ladle's weight."""
    values = robot.kinematics.joint_values(pose)
    lengths = np.array([values[stroke] for stroke in STROKES])
    carried = 0.25 * GRAVITY_M_S2 * (payload_kg + robot.layout.ladle.tare.value)
    return PartStiffness.of(robot.layout, lengths, carried, properties)


def under_weight(robot: PouringRobot, stiffness: PartStiffness, payload_kg: float) -> PouringRobot:
    """Return the robot as built, carrying its own weight and a payload; for one pose, as stiffness depends on the pose.

    The given robot carries no loads. The melt's centre is at half the ladle's height. Leg drives yield along their
    legs and the tilt drive about its axis. Each chain's end yields against the platform: in translation like its two
    U joints along the leg, in rotation like the leg in torsion, both the same in all directions.
    """
    *legs, tilt = robot.nominal_solver.mechanism.loops.drives
    axial = dict(zip(STROKES, stiffness.leg_axial.tolist(), strict=True))
    ladle = robot.layout.ladle
    loads = Loads(
        gravity=True,
        payload_kg=payload_kg,
        payload_frame=robot.model.definition.payload_frame,
        payload_centre_m=(0.0, 0.0, -0.5 * ladle.height.metres),
        drive_stiffness={name: axial[name] for name in legs} | {tilt: stiffness.tilt_drive},
    )
    held = LoopStiffness(
        translation=AxialStiffness(value=stiffness.joint, unit="N/m", source="assumed"),
        rotation=TorsionStiffness(value=float(stiffness.leg_torsion.mean()), unit="Nm/rad", source="assumed"),
    )
    mechanism = robot.actual_solver.mechanism.with_stiffness(held)
    loaded = copy.copy(robot)  # not a new robot: the nominal side is the same, and building it takes time
    loaded.actual_solver = ClosureSolver(mechanism, loads, robot.actual_solver.options)
    return loaded


def truss_sag_m(
    robot: PouringRobot, payload_kg: float, properties: StiffnessProperties | None = None
) -> tuple[float, float]:
    """Return how far the trolley's two girders sag in their middle, as beams on two rigid rails, in m.

    The first is under the load they carry there: trolley, robot and payload. The second is under their own weight,
    which counts five eighths of one in the middle: :math:`5 W L^3 / (384 E I)` (Roark, table 8.1).
    """
    model = robot.nominal_solver.mechanism.shared_model
    data = model.createData()
    pin.computeSubtreeMasses(model, data)
    trolley = robot.nominal_solver.mechanism.joint_id(robot.nominal_solver.mechanism.loops.locked_joints[-1])
    truss = robot.layout.truss
    width, height, wall = (s.metres for s in (truss.girder_width, truss.girder_height, truss.girder_wall))
    inside, clear = width - 2.0 * wall, height - 2.0 * wall
    inertia = (width * height**3 - inside * clear**3) / 12.0
    own_kg = robot.layout.materials.steel_density.value * (width * height - inside * clear) * truss.gauge.metres
    modulus = (properties or load_stiffness()).steel.youngs_modulus.value
    softness = GRAVITY_M_S2 * beam(modulus, inertia, truss.gauge.metres)  # of one girder, in m/kg
    return 0.5 * softness * (float(data.mass[trolley]) + payload_kg), 0.625 * softness * own_kg
