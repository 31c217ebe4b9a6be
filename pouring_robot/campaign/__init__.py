"""Measured data: one static pose a row, what was commanded, under which conditions, what was seen.

Reading and writing the two files of a campaign, plans of poses, and measuring a virtual robot.
"""

from pouring_robot.campaign.data import Campaign
from pouring_robot.campaign.metadata import CampaignMetadata
from pouring_robot.campaign.nominal import PoseStack, nominal_poses
from pouring_robot.campaign.plan import PosePlan, random_plan, read_plan
from pouring_robot.campaign.simulate import MeasurementOptions, VirtualMeasurement, simulate_campaign
from pouring_robot.robot.pouring.names import DRIVE_JOINTS

__all__ = [
    "DRIVE_JOINTS",
    "Campaign",
    "CampaignMetadata",
    "MeasurementOptions",
    "PosePlan",
    "PoseStack",
    "VirtualMeasurement",
    "nominal_poses",
    "random_plan",
    "read_plan",
    "simulate_campaign",
]
