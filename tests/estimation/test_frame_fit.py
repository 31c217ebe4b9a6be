"""The outer frames of any robot: from any start, few rows or many, gross errors or not, and directions left open."""

import numpy as np
import pinocchio as pin
import pytest
import scipy.special
from scipy.spatial.transform import Rotation

from pouring_robot.campaign.nominal import PoseStack, nominal_poses
from pouring_robot.estimation.frames.fit import fit_frames
from pouring_robot.estimation.frames.outer import FRAME_PARAMETERS, OuterFrames
from pouring_robot.estimation.frames.starts import affine_map

NAMES = [parameter.name for parameter in FRAME_PARAMETERS]
TARGET_TURNS = {"tool.rx", "tool.ry", "tool.rz"}
# Huber's weights cost a twentieth of the information, and rows in error shift the answer a little.
WORSE = 1.5
ONCE_IN_A_MILLION = 1e-6


def arm(random, rows, reach):
    """Any position, any attitude."""
    return random.uniform(-reach, reach, (rows, 3)), Rotation.random(rows, random_state=random).as_matrix()


def line(random, rows, reach):
    _, rotation = arm(random, rows, reach)
    return np.outer(random.uniform(-reach, reach, rows), random.normal(size=3)), rotation


def plane(random, rows, reach):
    position, rotation = arm(random, rows, reach)
    position[:, 2] = 0.3
    return position, rotation


def wrist(random, rows, reach):
    """One position, any attitude."""
    position, rotation = arm(random, rows, reach)
    return np.tile(position[:1], (rows, 1)), rotation


def gantry(random, rows, reach):
    """Any position, one attitude."""
    position, rotation = arm(random, rows, reach)
    return position, np.tile(rotation[:1], (rows, 1, 1))


def one_axis(random, rows, reach):
    """Any position, rotations about one axis only."""
    position, rotation = arm(random, rows, reach)
    axis = random.normal(size=3)
    angles = random.uniform(-1.0, 1.0, (rows, 1))
    return position, Rotation.from_rotvec(angles * axis / np.linalg.norm(axis)).as_matrix() @ rotation[0]


def turntable(random, rows, reach):
    """Positions on the circle of one hinge."""
    position, rotation = one_axis(random, rows, reach)
    return rotation @ position[0] + position[1], rotation


class Case:
    """What an instrument sees of random poses, with random frames, noise and gross errors."""

    def __init__(self, kind, seed, full, gross=0.05, rows=None):
        random = np.random.default_rng(seed)
        rows = rows or int(np.exp(random.uniform(np.log(8.0), np.log(301.0))))
        self.poses = PoseStack(*kind(random, rows, 10.0 ** random.uniform(-1.0, 0.3)))
        turns = Rotation.random(2, random_state=random).as_matrix()
        outer = pin.SE3(turns[0], random.normal(size=3) * 5.0 * random.uniform())
        self.truth = OuterFrames(outer, pin.SE3(turns[1], 0.2 * random.normal(size=3)))
        self.sigma_m, self.sigma_rad = 10.0 ** random.uniform(-5.0, -3.0), 10.0 ** random.uniform(-4.5, -3.0)
        seen = self.truth.seen(self.poses)
        self.position = seen.position_m + self.sigma_m * random.normal(size=(rows, 3))
        noise = Rotation.from_rotvec(self.sigma_rad * random.normal(size=(rows, 3)))
        self.rotation = noise.as_matrix() @ seen.rotation if full else None
        for values in (self.position, self.rotation) if full else (self.position,):
            wrong = np.flatnonzero(random.random(rows) < gross)[: rows // 8]
            far = 10.0 ** random.uniform(-1.0, 1.0) * random.normal(size=(wrong.size, 3))
            values[wrong] = values[wrong] + far if values.ndim == 2 else Rotation.from_rotvec(far).as_matrix()

    def fit(self):
        return fit_frames(self.poses, self.position, self.rotation, self.sigma_m / self.sigma_rad)

    def chi_square(self, fit):
        """Return the chi-square of the whitened difference between what the fitted frames predict and the truth."""
        error = fit.frames.seen(self.poses).difference(self.truth.seen(self.poses))
        size = ((error[:, :3] / self.sigma_m) ** 2).sum()
        return size if self.rotation is None else size + ((error[:, 3:] / self.sigma_rad) ** 2).sum()


@pytest.mark.parametrize("full", [True, False])
@pytest.mark.parametrize("first", range(0, 60, 20))
def test_frames_of_any_arm_come_back_within_their_covariance(first, full):
    for seed in range(first, first + 20):
        case = Case(arm, seed, full)
        fit = case.fit()
        assert len(fit.undetermined) == (0 if full else 3)
        bound = WORSE * scipy.special.chdtri(12 - len(fit.undetermined), ONCE_IN_A_MILLION)
        assert case.chi_square(fit) < bound, seed


# Poses X of a robot leave a displacement D of the target open where X D X⁻¹ is the same for all: the base absorbs it.
OPEN = {line: 0, plane: 0, wrist: 0, gantry: 3, one_axis: 1, turntable: 2}


@pytest.mark.parametrize("kind", OPEN)
@pytest.mark.parametrize("full", [True, False])
def test_directions_that_poses_leave_open_are_reported_and_the_others_found(kind, full):
    for seed in range(8):
        case = Case(kind, seed, full)
        fit = case.fit()
        assert len(fit.undetermined) == OPEN[kind] + (0 if full else 3)
        bound = WORSE * scipy.special.chdtri(12 - len(fit.undetermined), ONCE_IN_A_MILLION)
        assert case.chi_square(fit) < bound, seed
        for shares in fit.undetermined:
            direction = np.array([shares.get(name, 0.0) for name in NAMES])
            assert direction[NAMES.index(next(iter(shares)))] == 1.0
            step = 1e-5 / np.abs(direction).max()
            moved = fit.frames.moved(step * direction).seen(case.poses).difference(fit.frames.seen(case.poses))
            shown = moved if full else moved[:, :3]
            # Of second order in the step.
            assert np.abs(shown).max() < 1e-4 * step * np.abs(direction).max()


def test_the_target_of_a_gantry_without_rotations_stays_at_its_start():
    case = Case(gantry, 3, full=False)
    frames = case.fit().frames
    np.testing.assert_allclose(frames.T_end_target.homogeneous, np.eye(4), atol=1e-12)
    straight = Case(lambda *wanted: (line(*wanted)[0], gantry(*wanted)[1]), 5, full=False, gross=0.0)
    undetermined = straight.fit().undetermined
    assert len(undetermined) == 7  # and the base may turn about the line
    assert {next(iter(shares)) for shares in undetermined[:6]} == {
        f"tool.{c}" for c in ("tx", "ty", "tz", "rx", "ry", "rz")
    }
    assert next(iter(undetermined[6])).startswith("base.r")


@pytest.mark.parametrize("full", [True, False])
def test_the_pouring_platform_turns_about_y_only(drawing, clean, full):
    poses = nominal_poses(drawing.kinematics, clean.campaign.drives)
    case = Case(arm, 1, full, gross=0.0, rows=len(poses))
    seen = case.truth.seen(poses)
    fit = fit_frames(poses, seen.position_m, seen.rotation if full else None)
    names = [tuple(shares) for shares in fit.undetermined]
    assert names.count(("tool.ty", "base.ty")) == 1
    assert {name[0] for name in names} == {"tool.ty"} | (set() if full else TARGET_TURNS)
    (shares,) = [shares for shares in fit.undetermined if next(iter(shares)) == "tool.ty"]
    assert shares["base.ty"] == pytest.approx(-1.0, abs=1e-9)


@pytest.mark.parametrize("seed", range(4))
def test_a_quarter_of_wrong_rows_does_not_spoil_the_fit_of_an_arm(seed):
    case = Case(arm, 100 + seed, full=bool(seed % 2), gross=0.0, rows=120)
    case.position[::4] += np.random.default_rng(seed).normal(size=(30, 3))
    error = case.fit().frames.seen(case.poses).difference(case.truth.seen(case.poses))
    assert np.abs(error[:, :3]).max() < 2.0 * case.sigma_m


@pytest.mark.parametrize("kind", [arm, one_axis, gantry])
def test_mirrored_axes_show_in_the_affine_map_of_any_robot(kind):
    case = Case(kind, 6, full=False, rows=60)
    rows = np.ones(60, dtype=bool)
    affine, spread = affine_map(case.poses, case.position, rows)
    assert spread > 0.1
    np.testing.assert_allclose(affine, case.truth.T_tracker_base.rotation, atol=0.02)
    mirrored, _ = affine_map(case.poses, case.position * [1.0, -1.0, 1.0], rows)
    assert np.linalg.det(mirrored) == pytest.approx(-1.0, abs=0.05)


def test_the_affine_map_of_a_plane_or_of_few_rows_is_undetermined():
    rows = np.ones(60, dtype=bool)
    flat = Case(lambda *wanted: (plane(*wanted)[0], gantry(*wanted)[1]), 2, full=False, rows=60)
    assert affine_map(flat.poses, flat.position, rows)[1] < 1e-9
    few = Case(arm, 2, full=False, rows=12)
    assert affine_map(few.poses, few.position, rows[:12])[1] == 0.0
