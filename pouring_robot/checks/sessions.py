"""Whether sessions measured from places of their own, though the campaign says that they did not."""

import dataclasses

import numpy as np

from pouring_robot.campaign.data import Campaign
from pouring_robot.campaign.metadata import PER_SESSION
from pouring_robot.campaign.nominal import PoseStack
from pouring_robot.checks.flags import DataFlag, FlagCode, found
from pouring_robot.estimation.frames.fit import fit_frames
from pouring_robot.estimation.frames.sessions import in_one_frame
from pouring_robot.exceptions import CampaignError, FrameFitError
from pouring_robot.mechanism.poses import MM
from pouring_robot.mechanism.rotations import rotation_matrices

_SET_UP_ANEW_M = 0.05  # what creeps or is bumped moves less
_TIMES_BETTER = 3.0


def in_frames_of_their_own(campaign: Campaign, poses: PoseStack) -> tuple[Campaign, list[DataFlag]]:
    """Return a campaign seen from one place; with a finding, where it does not say that it was not.

    That is where each session by itself agrees with the robot far better than all from one place.
    """
    if len(set(campaign.sessions)) < 2 or campaign.metadata.frames == PER_SESSION:
        return in_one_frame(campaign, poses), []
    metadata = campaign.metadata.model_copy(update={"frames": PER_SESSION})
    try:
        together = in_one_frame(dataclasses.replace(campaign, metadata=metadata), poses)
        before, after = (_misfit_m(one, poses) for one in (campaign, together))
    except (CampaignError, FrameFitError):
        return campaign, []  # too few rows to say
    moved = float(np.nanmax(np.linalg.norm(together.position_m - campaign.position_m, axis=1)))
    if moved < _SET_UP_ANEW_M or before < _TIMES_BETTER * after:
        return campaign, []
    message = (
        f"sessions measured from places up to {moved:.3g} m apart: from one place they miss the robot by "
        f"{before / MM:.3g} mm a coordinate, with frames of their own by {after / MM:.3g} mm"
    )
    return together, [found(campaign, FlagCode.APART_SESSIONS, message, metrics={"apart_m": moved})]


def _misfit_m(campaign: Campaign, poses: PoseStack) -> float:
    vectors = campaign.rotation_vector_rad
    return fit_frames(
        poses, campaign.position_m, None if vectors is None else rotation_matrices(vectors)
    ).position_scale_m
