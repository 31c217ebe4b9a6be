"""The DH table against plain formulas, against Pinocchio, and against perturbed URDFs."""

import numpy as np
import pinocchio as pin
import pytest

from pouring_robot.exceptions import BadInputError, NoSolutionError, UnknownJointError
from pouring_robot.mechanism.closed_chain import ClosedChainMechanism
from pouring_robot.robot.dh import DHTable, NotUPUError, UnknownParameterError
from pouring_robot.robot.dh.chain import inverse
from pouring_robot.robot.model import RobotModel
from pouring_robot.robot.pouring.kinematics import FourUPUKinematics
from pouring_robot.robot.pouring.layout import render_urdf
from tests.support import displacement, perturbed

LAYOUTS = ("paper", "wide")
CHAINS = (1, 2, 3, 4)
TRANSFORMS = ("O0", "01", "12", "23", "34", "45", "56", "6o")
VARIABLES = ("theta_e{}_2", "theta_e{}_3", "d_e{}_4", "theta_e{}_5", "theta_e{}_6")
# In mm: U-joint centres on the fixed and on the moving platform.
CENTRES = {
    "paper": ((340.0, 374.0), (182.5, 330.0)),
    "wide": ((187.0, 340.0), (165.0, 182.5)),
}
SIGNS = {1: (-1, 1), 2: (-1, -1), 3: (1, 1), 4: (1, -1)}


@pytest.fixture(scope="module", params=LAYOUTS)
def layout(request):
    return request.param


@pytest.fixture(scope="module")
def nominal(layout):
    return RobotModel(layout=layout).definition.mechanism()


@pytest.fixture(scope="module")
def table(nominal):
    return DHTable.from_mechanism(nominal)


def names_of(chain):
    for transform in TRANSFORMS:
        to = transform[1]
        yield f"a_e{chain}_{transform}", f"alpha_e{chain}_{transform}", f"d_e{chain}_{to}", f"theta_e{chain}_{to}"


def rotation(axis, angle):
    matrix = np.eye(4)
    matrix[:3, :3] = pin.utils.rotate(axis, angle)
    return matrix


def shift(axis, way):
    matrix = np.eye(4)
    matrix["xyz".index(axis), 3] = way
    return matrix


def plain_product(table, chain, values, errors):
    """Tx Rx Tz Rz, eight times, written out from the names."""
    numbers = {p.name: p.nominal + errors.get(p.name, 0.0) for p in table.parameters}
    for pattern, value in zip(VARIABLES, values, strict=True):
        numbers[pattern.format(chain)] += value
    pose = np.eye(4)
    for a, alpha, d, theta in names_of(chain):
        step = shift("x", numbers[a]) @ rotation("x", numbers[alpha])
        pose = pose @ step @ shift("z", numbers[d]) @ rotation("z", numbers[theta])
    return pose


def pinocchio_pose(mechanism, chain, values):
    """O to foot, then from the seat back to the platform: the chain as the URDF has it."""
    joints = {f"leg{chain}_s{k}": v for k, v in enumerate(values, start=1)}
    model = mechanism.shared_model
    data = model.createData()
    q = mechanism.with_joint_values(mechanism.neutral_configuration(), joints)
    pin.framesForwardKinematics(model, data, q)
    base, foot, seat, end = (
        data.oMf[mechanism.frame_id(name)]
        for name in ("fixed_platform", f"leg{chain}_foot", f"leg{chain}_seat", "moving_platform")
    )
    return (base.actInv(foot) * seat.actInv(end)).homogeneous


def random_values(rng, count=20):
    """Any joint values, not only those in use: the identities hold everywhere."""
    return rng.uniform([-1.5, -1.0, 0.3, -1.0, -1.5], [1.5, 1.0, 1.0, 1.0, 1.5], (count, 5))


def random_errors(rng, table, size=5e-3):
    return {p.name: rng.uniform(-size, size) for p in table.parameters if p.role != "convention"}


def random_placements(rng, table, size=5e-3):
    return {joint: displacement(rng.uniform(-size, size, 3), rng.uniform(-size, size, 3)) for joint in table.joints}


# --- names, counts, nominal values ---


def test_names_and_order(table):
    expected = [name for chain in CHAINS for four in names_of(chain) for name in four]
    assert [p.name for p in table.parameters] == expected
    assert len(expected) == 128
    for p in table.parameters:
        assert p.unit == ("m" if p.name[:2] in ("a_", "d_") else "rad")


def test_drop_outs_are_those_of_the_design(table):
    expected = {f"{name}_e{c}_{frame}" for c in CHAINS for name, frame in (("a", "O0"), ("alpha", "O0"), ("d", "0"))}
    expected |= {f"theta_e{c}_{k}" for c in (1, 2, 3) for k in (2, 3, 5, 6)}
    expected |= {"theta_e4_2", "theta_e4_3", "theta_e4_5", "d_e4_4"}
    assert {p.name for p in table.parameters if p.drops_out} == expected
    assert len(table.selection()) == 100
    assert all(len(table.selection(chain=c)) == 25 for c in CHAINS)
    assert len(table.parameters) == 128
    assert {p.name for p in table.parameters if p.role == "drive"} == {"d_e1_4", "d_e2_4", "d_e3_4", "theta_e4_6"}


def test_nominal_values_are_the_layout(table, layout):
    (fixed_x, fixed_y), (moving_x, moving_y) = CENTRES[layout]
    for chain, (_, side) in SIGNS.items():
        lengths = {
            f"a_e{chain}_01": fixed_x,
            f"d_e{chain}_1": side * fixed_y,
            f"d_e{chain}_6": -side * moving_y,
            f"a_e{chain}_6o": moving_x,
        }
        for p in (p for p in table.parameters if p.chain == chain):
            if p.unit == "m":
                assert p.nominal == pytest.approx(lengths.get(p.name, 0.0) * 1e-3, abs=1e-15)
        assert table[f"theta_e{chain}_2"].nominal == pytest.approx(0.0, abs=1e-15)
        for name in ("alpha_e{}_23", "alpha_e{}_34"):
            assert table[name.format(chain)].nominal == pytest.approx(np.pi / 2)
        for name in ("alpha_e{}_45", "alpha_e{}_56"):
            assert table[name.format(chain)].nominal == pytest.approx(-np.pi / 2)
        assert abs(table[f"theta_e{chain}_1"].nominal) == pytest.approx(np.pi / 2)


def test_axes_lie_where_the_design_puts_them(table):
    # At joint value zero the leg hangs straight down, so the axes of the frames are the platform's.
    expected_z = [(0, 0, 1), (0, 1, 0), (0, 1, 0), (1, 0, 0), (0, 0, -1), (1, 0, 0), (0, 1, 0), (0, 0, 1)]
    for chain in CHAINS:
        pose = np.eye(4)
        for names, z in zip(names_of(chain), expected_z, strict=True):
            a, alpha, d, theta = (table[name].nominal for name in names)
            pose = pose @ shift("x", a) @ rotation("x", alpha) @ shift("z", d) @ rotation("z", theta)
            assert pose[:3, 2] == pytest.approx(z, abs=1e-15)
            if names[2] == f"d_e{chain}_1":
                # x_1, about which alpha_12 turns, is vertical and goes through the U-joint centre.
                assert pose[:3, 0] == pytest.approx((0, 0, -1), abs=1e-15)
                centre = table[f"a_e{chain}_01"].nominal * SIGNS[chain][0], table[f"d_e{chain}_1"].nominal, 0.0
                assert pose[:3, 3] == pytest.approx(centre, abs=1e-15)


def test_parameters_describe_themselves(table):
    assert "leg1_s2" in table["theta_e1_3"].reason and table["theta_e1_3"].part == "fixed rod"
    parts = {p.transform: p.part for p in table.parameters}
    assert list(parts.values()) == [
        "fixed-platform installation",
        *("upper U joint", "upper U joint", "fixed rod", "moving rod", "lower U joint", "lower U joint"),
        "moving-platform installation",
    ]


# --- the table is the URDF ---


@pytest.mark.parametrize("chain", CHAINS)
def test_nominal_chain_is_pinocchios(table, nominal, chain):
    for values in random_values(np.random.default_rng(chain)):
        ours = table.chain_poses(chain, values)
        assert np.abs(ours - pinocchio_pose(nominal, chain, values)).max() < 1e-12
        assert np.abs(ours - plain_product(table, chain, values, {})).max() < 1e-12


def test_any_carrying_chain_gives_the_same_table(table, layout):
    other = DHTable.from_mechanism(
        ClosedChainMechanism(render_urdf(layout, chain_order=(3, 1, 4, 2)), RobotModel().definition.loops)
    )
    assert other.parameters == table.parameters


def test_arrays_of_joint_values(table):
    values = random_values(np.random.default_rng(3), 6).reshape(2, 3, 5)
    poses = table.chain_poses(2, values, {"d_e2_3": 1e-3})
    assert poses.shape == (2, 3, 4, 4)
    single = table.chain_poses(2, values[1, 2], {"d_e2_3": 1e-3})
    assert np.abs(single - poses[1, 2]).max() < 1e-15


# --- DH errors to placements ---


@pytest.mark.parametrize("chain", CHAINS)
def test_errors_become_placements_exactly(table, nominal, chain):
    rng = np.random.default_rng(10 + chain)
    errors = random_errors(rng, table) | {
        f"{n}_e{chain}_{f}": 3e-3 for n, f in (("a", "O0"), ("alpha", "O0"), ("d", "0"))
    }
    actual = perturbed(nominal, table.placement_errors(errors))
    for values in random_values(rng):
        expected = plain_product(table, chain, values, errors)
        assert np.abs(pinocchio_pose(actual, chain, values) - expected).max() < 1e-12
        assert np.abs(table.chain_poses(chain, values, errors) - expected).max() < 1e-12


def test_each_error_displaces_the_joint_it_names(table):
    for p in table.parameters:
        assert list(table.placement_errors({p.name: 4e-3})) == [p.joint]
    assert table.placement_errors({"a_e1_01": 0.0}) == {}


def test_twists_are_the_derivative(table):
    step = 1e-4
    for p in table.parameters:
        ends = [table.placement_errors({p.name: s * step})[p.joint].homogeneous for s in (1, -1)]
        difference = pin.log6(pin.SE3(inverse(ends[1]) @ ends[0])).vector / (2 * step)
        assert np.abs(difference - p.twist).max() < 1e-8
        assert (p.local.name, p.local.unit, p.local.joint, p.local.twist) == (p.name, p.unit, p.joint, p.twist)


def test_known_twists(table, layout):
    # On the nominal axes: alpha_12 turns the upper U joint about the vertical, theta_1 about y, alpha_01 about X of O.
    fixed_y = CENTRES[layout][0][1] * 1e-3
    assert table["alpha_e1_12"].twist == pytest.approx((0, 0, 0, 0, 0, -1), abs=1e-15)
    assert table["theta_e1_1"].twist == pytest.approx((0, 0, 0, 0, 1, 0), abs=1e-15)
    # A rotation by -1 about X of O moves a point at y by -y in z.
    assert table["alpha_e1_01"].twist == pytest.approx((0, 0, -fixed_y, -1, 0, 0), abs=1e-15)
    # The lower centre in platform axes: a longer a_6o moves the seat away from o.
    assert table["a_e1_6o"].twist == pytest.approx((-1, 0, 0, 0, 0, 0), abs=1e-15)


# --- placements to DH errors ---


@pytest.mark.parametrize("chain", CHAINS)
def test_placements_become_errors_exactly(table, nominal, chain):
    rng = np.random.default_rng(20 + chain)
    placements = random_placements(rng, table)
    errors = table.errors_from_placements(placements)
    assert len(errors) == 4 * 29
    actual = perturbed(nominal, placements)
    for values in random_values(rng):
        expected = pinocchio_pose(actual, chain, values)
        assert np.abs(plain_product(table, chain, values, errors) - expected).max() < 1e-12


@pytest.mark.parametrize("size", [1e-7, 5e-3, 5e-2])
def test_round_trip_gives_the_same_machine_and_no_larger_errors(table, size):
    rng = np.random.default_rng(7)
    given = random_errors(rng, table, size)
    back = table.errors_from_placements(table.placement_errors(given))
    for chain in CHAINS:
        values = random_values(rng)
        gap = table.chain_poses(chain, values, given) - table.chain_poses(chain, values, back)
        assert np.abs(gap).max() < 1e-12
    assert norm(table, back) <= norm(table, given)
    again = table.errors_from_placements(table.placement_errors(back))
    assert np.abs(np.subtract(list(again.values()), list(back.values()))).max() < 1e-12


def norm(table, errors):
    return np.linalg.norm([value / (2e-4 if table[name].unit == "m" else 4e-3) for name, value in errors.items()])


def test_the_found_errors_are_the_smallest(table):
    """Every small change of the errors that leaves the chain unchanged makes them larger."""
    rng = np.random.default_rng(9)
    found = table.errors_from_placements(random_placements(rng, table))
    for chain in CHAINS:
        own = [name for name in found if f"_e{chain}_" in name]
        unseen = unseen_changes(table, chain, own, found)
        # 29 numbers, of which the pose shows 24.
        assert unseen.shape == (5, 29)
        for change in (*unseen, *(-unseen), *rng.normal(size=(10, 5)) @ unseen):
            moved = found | {name: found[name] + 1e-4 * way for name, way in zip(own, change, strict=True)}
            assert norm(table, moved) > norm(table, found)


def unseen_changes(table, chain, names, errors):
    """Return the directions in which a change of the errors shows at no joint values, by finite differences."""
    values = random_values(np.random.default_rng(1), 10)
    columns = []
    for name in names:
        up, down = (table.chain_poses(chain, values, errors | {name: errors[name] + s * 1e-5}) for s in (1, -1))
        columns.append((up - down)[:, :3].ravel() / 2e-5)
    _, sizes, axes = np.linalg.svd(np.array(columns).T, full_matrices=False)
    return axes[sizes < 1e-6]


def test_a_single_error_is_recovered_where_no_other_is_equivalent(table):
    # The twist of the leg about itself and the tilts inside the rods have no equivalent.
    for name in ("theta_e1_4", "alpha_e2_34", "alpha_e3_45", "alpha_e4_23", "theta_e1_o", "alpha_e2_56"):
        back = table.errors_from_placements(table.placement_errors({name: 4e-3}))
        assert back[name] == pytest.approx(4e-3, abs=1e-13)
        assert max(abs(value) for other, value in back.items() if other != name) < 1e-13


# --- the paper's chain 1, by which the free conventions were chosen ---


def test_open_branch_has_the_papers_sensitive_errors():
    nominal = RobotModel(layout="paper").definition.mechanism()
    table, rng = DHTable.from_mechanism(nominal), np.random.default_rng(2022)
    positions = rng.uniform((-0.15, -0.05, -0.825), (-0.05, 0.05, -0.425), (1000, 3))
    values = FourUPUKinematics(nominal).chain_joints(positions, rng.uniform(-0.4884, 1.08155, 1000))[:, 0]
    assert np.abs(table.chain_poses(1, values)[:, :3, 3] - positions).max() < 1e-12
    shifts = {
        p.name: table.chain_poses(1, values, {p.name: 2e-4 if p.unit == "m" else 4e-3})[:, :3, 3] - positions
        for p in table.selection(chain=1)
    }
    sensitive = {name: "xyz"[np.abs(s).mean(axis=0).argmax()] for name, s in shifts.items() if np.abs(s).max() > 1e-3}
    assert sensitive == {
        **dict.fromkeys(("theta_e1_1", "alpha_e1_12", "alpha_e1_23", "alpha_e1_34", "theta_e1_4", "alpha_e1_56"), "x"),
        "alpha_e1_01": "y",
    }
    spread = {name: s.std(axis=0).max() for name, s in shifts.items()}
    assert spread["theta_e1_1"] == pytest.approx(spread["alpha_e1_01"], rel=0.01)
    assert spread["alpha_e1_12"] < 0.3 * spread["theta_e1_1"]
    for name in ("alpha_e1_6o", "theta_e1_o"):
        assert np.abs(shifts[name]).max() < 1e-12
    # They accumulate at the platform's half-width times 4 mrad (the paper: 1.3175 mm, the middle of such a bin).
    edges = np.arange(-1.4, 0.0, 0.005) * 1e-3
    for name in ("alpha_e1_56", "theta_e1_4"):
        counts, _ = np.histogram(shifts[name][:, 0], edges)
        assert edges[counts.argmax()] + 2.5e-6 == pytest.approx(-1.3175e-3, abs=5.1e-6)


# --- what is refused ---


def test_unknown_names(table):
    with pytest.raises(UnknownParameterError, match="did you mean 'alpha_e1_56'"):
        table.placement_errors({"alfa_e1_56": 1e-3})
    with pytest.raises(UnknownParameterError, match="names are like"):
        table["x"]
    with pytest.raises(UnknownJointError, match="ladle_mount"):
        table.errors_from_placements({"ladle_mount": displacement()})


def test_bad_numbers(table):
    with pytest.raises(BadInputError, match="finite"):
        table.placement_errors({"a_e1_01": float("nan")})
    with pytest.raises(BadInputError, match="no chain 5"):
        table.chain_poses(5, np.zeros(5))
    with pytest.raises(BadInputError, match="five joints"):
        table.chain_poses(1, np.zeros(4))


def test_invalid_errors(table):
    turned = {f"leg1_s{k}": displacement((1.0, 1.0, -1.0), (2.0, -3.0, 2.5 - k)) for k in range(1, 6)}
    with pytest.raises(NoSolutionError, match="mm and mrad"):
        table.errors_from_placements(turned)


def test_a_robot_as_built_has_no_nominal_table(nominal):
    tilted = perturbed(nominal, {"leg2_s3": displacement((0.0, 0.0, 0.0), (0.0, 1e-3, 0.0))})
    with pytest.raises(NotUPUError, match="'leg2_s2' and 'leg2_s3' are 1 mrad from"):
        DHTable.from_mechanism(tilted)
    shifted = perturbed(nominal, {"leg3_s4": displacement((0.0, 1e-3, 0.0))})
    with pytest.raises(NotUPUError, match=r"'leg3_s3' and 'leg3_s4' .* by 1 mm"):
        DHTable.from_mechanism(shifted)


def test_other_kinds_of_chain_are_refused(nominal):
    urdf = nominal.urdf.replace('name="leg1_s3" type="prismatic"', 'name="leg1_s3" type="revolute"')
    assert urdf != nominal.urdf
    with pytest.raises(NotUPUError, match="R R R R R, not R R P R R"):
        DHTable.from_mechanism(ClosedChainMechanism(urdf, nominal.loops))
    loops = nominal.loops.model_copy(update={"end_frame": None})
    with pytest.raises(NotUPUError, match="end frame"):
        DHTable.from_mechanism(ClosedChainMechanism(nominal.urdf, loops))


def test_inverse_is_pinocchios():
    rng = np.random.default_rng(1)
    for twist in rng.normal(size=(5, 6)):
        pose = pin.exp6(twist)
        assert np.abs(inverse(pose.homogeneous) - pose.inverse().homogeneous).max() < 1e-14
