"""MuJoCo, given our own URDF and equality constraints, comes to rest at the pose of the closed forms.

It is another engine with another principle: MuJoCo closes the loops by forces of soft constraints that pull the
bodies through a damped motion, independently of our solver. Nominally everything fits, so at rest nothing is strained.
"""

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from lxml import etree

from tests.support import displaced, pose_gap, random_poses

STEPS = 1_500


def bare_urdf(urdf):
    """Return the URDF without shapes, and with the two compiler settings that keep frame links as bodies."""
    root = etree.fromstring(urdf.encode())
    for link in root.iterfind("link"):
        for shape in [*link.iterfind("visual"), *link.iterfind("collision")]:
            link.remove(shape)
    extension = etree.SubElement(root, "mujoco")
    etree.SubElement(extension, "compiler", fusestatic="false", discardvisual="true", balanceinertia="false")
    return etree.tostring(root, encoding="unicode")


def closed_model(urdf, drives):
    """Return MuJoCo's model of the tree, closed by welds, its drives held by joint equalities."""
    spec = mujoco.MjSpec.from_string(bare_urdf(urdf))
    spec.option.gravity = np.zeros(3)
    spec.option.timestep = 0.002
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.solver = mujoco.mjtSolver.mjSOL_NEWTON
    spec.option.iterations = 100
    spec.option.tolerance = 1e-14
    for joint in spec.joints:
        # Damped: a path to the rest position, not a motion.
        joint.damping = np.full_like(np.asarray(joint.damping), 10.0)
        joint.limited = mujoco.mjtLimited.mjLIMITED_FALSE

    def equality(kind, name1, name2=""):
        one = spec.add_equality()
        one.type, one.name1, one.name2 = kind, name1, name2
        one.solref = np.array([0.02, 1.0])
        one.solimp = np.array([0.9999, 0.9999, 0.001, 0.5, 2.0])
        return one

    # Chain 1 carries the platform rigidly in the tree; the other three feet are welded to their seats.
    for chain in (2, 3, 4):
        weld = equality(mujoco.mjtEq.mjEQ_WELD, f"leg{chain}_foot", f"leg{chain}_seat")
        weld.objtype = mujoco.mjtObj.mjOBJ_BODY
        weld.data[:] = 0.0
        weld.data[6] = 1.0  # relative orientation: none
        # A radian counts as ten metres: held by legs in pairs of planes, the platform is weak sideways, where it is
        # stiffened by the parallelism of the joints.
        weld.data[10] = 10.0
    for name in (*drives, "truss_travel", "trolley_travel"):
        equality(mujoco.mjtEq.mjEQ_JOINT, name).data[:] = 0.0
    return spec.compile()


@pytest.fixture(scope="module")
def machine(drawing):
    """MuJoCo's model and workspace, and the indices of its joints and drives."""
    drives = drawing.nominal_solver.mechanism.loops.drives
    model = closed_model(drawing.model.definition.urdf(), drives)
    joints = {model.joint(k).name: model.joint(k).qposadr[0] for k in range(model.njnt)}
    return model, mujoco.MjData(model), joints


def test_the_tree_is_the_same_robot(drawing, machine):
    """Before anything is closed: every link is where Pinocchio puts it, and has the same mass."""
    model, data, joints = machine
    tree = pin.buildModelFromXML(drawing.model.definition.urdf())
    workspace = tree.createData()
    random = np.random.default_rng(90)
    configuration = random.uniform(-0.5, 0.5, tree.nq)
    for name, address in joints.items():
        data.qpos[address] = configuration[tree.joints[tree.getJointId(name)].idx_q]
    mujoco.mj_kinematics(model, data)
    pin.framesForwardKinematics(tree, workspace, configuration)
    for link in ("fixed_platform", "moving_platform", "ladle", "leg2_foot", "leg2_seat", "leg4_moving_rod"):
        body = data.body(link)
        theirs = pin.SE3(body.xmat.reshape(3, 3), body.xpos)
        mine = workspace.oMf[tree.getFrameId(link)]
        assert pose_gap(theirs, mine) == pytest.approx([0.0, 0.0], abs=1e-9)
    # MuJoCo counts the root link to the world, which has no mass.
    assert model.body_mass.sum() == pytest.approx(sum(inertia.mass for inertia in tree.inertias), rel=1e-6)


def settle(machine, drives, start):
    """Hold the drives, start at the given joint values, release, and return the platform at rest."""
    model, data, joints = machine
    mujoco.mj_resetData(model, data)
    for name, value in start.items():
        data.qpos[joints[name]] = value
    for k in range(model.neq):
        if model.eq_type[k] == mujoco.mjtEq.mjEQ_JOINT:
            model.eq_data[k, 0] = drives.get(model.joint(model.eq_obj1id[k]).name, 0.0)
    for _ in range(STEPS):
        mujoco.mj_step(model, data)
    base, platform = (
        pin.SE3(data.body(name).xmat.reshape(3, 3).copy(), data.body(name).xpos.copy())
        for name in ("fixed_platform", "moving_platform")
    )
    return base.actInv(platform), float(np.abs(data.qvel).max())


def test_mujoco_settles_at_our_nominal_pose(drawing, machine):
    random = np.random.default_rng(91)
    gaps = []
    for pose in random_poses(50, seed=92):
        location = drawing.locate(pose)
        start = drawing.kinematics.joint_values(displaced(pose, random))
        # Not only along the mechanism's own freedoms: every joint is off a little, so the loops are open.
        start = {name: value + random.uniform(-0.005, 0.005) for name, value in start.items()}
        found, speed = settle(machine, location.drives, start)
        assert speed < 1e-9  # m/s or rad/s: it is at rest
        gaps.append(pose_gap(found, location.nominal.pose_base_to_end))
    assert np.max(gaps, axis=0) == pytest.approx([0.0, 0.0], abs=1e-9)
