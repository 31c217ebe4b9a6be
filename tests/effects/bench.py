"""A campaign of the independent machine of tests/rig, read by the library: the same rows in two formulations.

The compared quantities are whitened motions of the target, (m,), with the two free frames projected out.
"""

import dataclasses
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from pouring_robot.campaign.data import Campaign
from pouring_robot.campaign.metadata import CampaignMetadata
from pouring_robot.diagnosis.rows import CampaignRows, OuterAndSessionFrames
from pouring_robot.effects import nominal_rows
from pouring_robot.effects.available import library
from pouring_robot.estimation.noise import NoiseLevel
from pouring_robot.mechanism.closed_chain import ClosedChainMechanism
from pouring_robot.mechanism.closure.energy import Loads
from pouring_robot.mechanism.closure.solver import ClosureSolver
from pouring_robot.robot.model import RobotModel
from pouring_robot.robot.pouring.definition import PouringDefinition
from tests.rig.conditions import CENTRE_OF_MASS, GRAVITY, PITCH_M, REFERENCE_DEGC, SPAN_M, TARE_KG, plan
from tests.rig.effects import FORMS, textbook
from tests.rig.machine import Errors
from tests.rig.metrology import Tracker, basis, without
from tests.rig.rotations import to_vector

SIGMA_M, SIGMA_RAD = 5e-5, 6e-5
NOISE = NoiseLevel.stated(SIGMA_M, SIGMA_RAD)
METADATA = CampaignMetadata(
    sigma_position_m=SIGMA_M,
    sigma_rotation_rad=SIGMA_RAD,
    screw_pitch_m=PITCH_M,
    truss_span_m=SPAN_M,
    ladle_tare_kg=TARE_KG,
    ladle_centre_of_mass_m=tuple(CENTRE_OF_MASS.tolist()),
    reference_temperature_degC=REFERENCE_DEGC,
)
BASE = np.array([2.1, -1.4, 0.6, 0.01, -0.02, 1.3])
TARGET = np.array([0.12, -0.07, 0.05, 0.01, 0.02, -0.01])
ROBOT = RobotModel().definition
EFFECTS = {effect.id: effect for effect in library(ROBOT)}
CHANNELS = tuple(f"drive.{drive.joint}" for drive in ROBOT.drives)


def stiff_drawing():
    """Return the drawing with joints a hundred thousand times stiffer than assumed: only drives yield."""
    model = RobotModel()
    loops = model.definition.loops
    stiffness = {
        name: quantity.model_copy(update={"value": 1e5 * quantity.value}) for name, quantity in loops.stiffness
    }
    stiffer = loops.model_copy(update={"stiffness": loops.stiffness.model_copy(update=stiffness)})
    return ClosedChainMechanism(model.urdf(), stiffer)


def soft_against_turning(mechanism, stiffness):
    """Return a mechanism whose closures yield in rotation with a stiffness, in Nm/rad."""
    rotation = mechanism.loops.stiffness.rotation.model_copy(update={"value": stiffness})
    return mechanism.with_stiffness(mechanism.loops.stiffness.model_copy(update={"rotation": rotation}))


def carried(mechanism, drawing, drives, payload_kg, drive_stiffness=()):
    """Return the platform's pose at drive values with a payload in the ladle's centre of mass, by the total energy."""
    loads = Loads(True, payload_kg, "moving_platform", tuple(CENTRE_OF_MASS.tolist()), dict(drive_stiffness))
    start = drawing.kinematics.configuration_at(drives)
    return ClosureSolver(mechanism, loads).solve(mechanism.named_drives(drives), start).pose_base_to_end


def campaign_of(scene, position, rotation):
    """Return a campaign of the rig's rows, with nothing rounded and exact thermometers."""
    rows = len(scene)
    return Campaign(
        robot=PouringDefinition(),
        path=Path("rig.csv"),
        metadata=METADATA,
        lines=np.arange(2, rows + 2),
        samples=tuple(map(str, range(rows))),
        sessions=tuple(f"{number:.0f}" for number in scene.session),
        headings={},
        ignored_columns=(),
        drives=scene.drives,
        position_m=position,
        rotation_vector_rad=rotation,
        approach=scene.approach,
        conditions={
            "time": scene.time_s,
            "payload": scene.payload_kg,
            "truss_travel": scene.travel_m,
            "melt": scene.melt,
            "ambient": scene.ambient,
            **{f"leg{k + 1}": values for k, values in enumerate(scene.leg_temperature.T)},
            "platform": scene.plate_temperature,
        },
    )


class Bench:
    """A faultless machine, measured without noise by a tracker that stands metres away."""

    def __init__(self, rows=70, sessions=3, seed=5):
        rng = np.random.default_rng(seed)
        scene = plan(rng, rows, sessions, local=True)
        true = np.column_stack([scene.leg_temperature, scene.plate_temperature])
        self.scene = dataclasses.replace(scene, thermometers=true)
        self.tracker = Tracker(BASE, TARGET, SIGMA_M, SIGMA_RAD)
        self.faultless = self.tracker.see(self.scene, Errors.none(rows))
        self.frames = basis(self.tracker.frames(self.faultless))
        self.campaign = self.measured(Errors.none(rows))
        self.rows = self.rows_of(self.campaign)
        # A faultless machine does not show where along the tilt axis the target sits, so the true frames are used.
        self.true_frames = OuterAndSessionFrames(
            *(pin.SE3(pin.exp3(f[3:]), f[:3]) for f in (BASE, TARGET)), np.zeros(0)
        )
        self.linear = self.rows.linearise(self.rows.unchanged(), self.true_frames)

    def measured(self, errors):
        """Return the campaign that a machine with errors gives."""
        position, quaternion = self.tracker.see(self.scene, errors)
        return campaign_of(self.scene, position, to_vector(quaternion))

    def rows_of(self, campaign, model=None):
        """Return the rows of a campaign, computed with the rig's gravity."""
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(nominal_rows, "GRAVITY_M_S2", GRAVITY)
            return CampaignRows(campaign, model or RobotModel(), NOISE)

    def seen_as(self, rows, changes, rng=None):
        """Return the campaign that the library's own closure predicts with changes, with noise if ``rng`` is given."""
        seen = rows.predicted(changes, self.true_frames)
        noise = np.zeros((2, len(rows), 3)) if rng is None else rng.normal(size=(2, len(rows), 3))
        turn = [pin.log3(pin.exp3(SIGMA_RAD * n) @ r) for n, r in zip(noise[1], seen.rotation, strict=True)]
        position = seen.position_m + SIGMA_M * noise[0]
        return dataclasses.replace(self.campaign, position_m=position, rotation_vector_rad=np.array(turn))

    def without(self, *names):
        """Return the conditions of the campaign without some of its quantities."""
        if names == ("approach",):
            return self.rows_of(dataclasses.replace(self.campaign, approach=None)).conditions
        return self.rows_of(self.campaign.with_conditions(**dict.fromkeys(names))).conditions

    def errors(self, effect, form, seed=1):
        """Return what a form of the rig does at size one."""
        return FORMS[effect][form](self.scene, np.random.default_rng(seed))

    def motion(self, errors, step=0.02):
        """Return the rig's exact motion for small errors, to first order: fourth-order central differences, (m,)."""
        found = []
        for size in (step, 2.0 * step):
            plus, minus = (self.tracker.see(self.scene, errors * (sign * size)) for sign in (1.0, -1.0))
            found.append(self.tracker.whiten(*self.tracker.difference(plus, minus)))
        return (8.0 * found[0] - found[1]) / (12.0 * step)

    def textbook(self, effect):
        """Return the rig's analytic first-order columns of an effect, (m, k)."""
        return self.tracker.in_own_frame(self.scene, textbook(self.scene)[effect])

    def form(self, effect, name):
        """Return a form of the library under the campaign's conditions."""
        return EFFECTS[effect].form(name, self.rows.conditions)

    def columns(self, effect, form, main=False):
        """Return the library's columns of a form in the rig's order of equations, (m, k); the main ones if asked."""
        parameters = [p for p in self.form(effect, form).parameters if p.main or not main]
        return self.ordered(np.column_stack([self.rows.column(p, self.linear) for p in parameters]))

    def ordered(self, values):
        """Return values (m, …) in the order row by row, component by component."""
        place = 6 * self.linear.row + self.linear.component
        out = np.empty_like(values)
        out[place] = values
        return out

    def valued(self, effect, form, values):
        """Return the library's first-order motion of a form with parameter values by name, (m,)."""
        parameters = {p.name: p for p in self.form(effect, form).parameters}
        chosen = [(parameters[name], value) for name, value in values.items()]
        return self.ordered(sum(self.rows.column(p, self.linear) / p.prior_std * value for p, value in chosen))

    def apart(self, first, second):
        """Return the distance of two motions (m,), up to what the frames absorb, relative to the first one."""
        first, second = without(first, self.frames), without(second, self.frames)
        return float(np.linalg.norm(first - second) / np.linalg.norm(first))

    def outside(self, motion, columns):
        """Return the share of a motion (m,) or (m, k) that frames and columns cannot make: the largest, 0 to 1."""
        motion = without(motion.reshape(len(motion), -1), self.frames)
        motion = motion[:, np.linalg.norm(motion, axis=0) > 1e-6 * np.linalg.norm(motion, axis=0).max()]
        left = without(motion, basis(without(columns, self.frames)))
        return float((np.linalg.norm(left, axis=0) / np.linalg.norm(motion, axis=0)).max())
