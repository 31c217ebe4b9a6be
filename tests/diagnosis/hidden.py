"""Small campaigns of the independent machine, each with a known hidden error."""

from dataclasses import replace

import numpy as np

from pouring_robot.campaign.data import Campaign
from pouring_robot.campaign.metadata import CampaignMetadata
from pouring_robot.robot.description.definition import RobotDefinition
from tests.examples.campaigns import ROBOTS, write
from tests.examples.machines import MACHINES
from tests.rig import Wanted, make_campaign, write_case

NOTHING: tuple[Wanted, ...] = ()
DRIFT = (Wanted("base_drift", 6.0, "a"),)
HOT = (Wanted("leg_thermal_expansion", 6.0, "a"),)
CENTRES_AND_LOAD = (Wanted("joint_centre_offset", 6.0, "a"), Wanted("leg_compliance", 6.0, "a"))
ZEROS = (Wanted("drive_zero_offset", 6.0, "a"),)


def campaign(folder, wanted, *, seed=5, rows=70, kind="single", **how):
    """Write a campaign and read it back; sound data, full poses, one session."""
    how = {"sessions": 1, "background": False, "full_pose": True, "spoilt": False} | how
    made = make_campaign(kind, seed, wanted=wanted, rows=rows, **how)
    return Campaign.read(write_case(folder, made) / "campaign.csv")


STEP_M = 1e-3


def stepped(folder):
    """Return a faultless machine whose tracker sees everything 1 mm higher after line 41 of the file."""
    data = campaign(folder, NOTHING)
    moved = np.array(data.position_m)
    moved[np.asarray(data.lines) > 41, 2] += STEP_M
    return replace(data, position_m=moved)


def distances_of_an_arm(folder, effect, ratio=None):
    """Return distances of the tool of the example arm, with something hidden in it, from a fixed point."""
    write(folder, MACHINES["arm"], 1, effect, ratio)
    seen = Campaign.read(folder / "campaign.csv", RobotDefinition.load(ROBOTS / "arm" / "robot.yaml"))
    metadata = CampaignMetadata(
        robot="arm", sigma_distance_m=seen.metadata.sigma_position_m, reference_temperature_degC=20.0
    )
    distance = np.linalg.norm(seen.position_m, axis=1)[:, None]
    nowhere = np.full_like(seen.position_m, np.nan)
    return replace(seen, metadata=metadata, position_m=nowhere, rotation_vector_rad=None, distance_m=distance)
