"""Measurement campaigns: reading them, checking them before any fit, and measuring a virtual robot (DESIGN §6)."""

from __future__ import annotations

from pouring_robot.campaign.blocks import Block, BlockKind
from pouring_robot.campaign.checks import Examination, check_campaign, examine
from pouring_robot.campaign.data import DRIVE_JOINTS, Campaign
from pouring_robot.campaign.flags import DataFlag, FlagCode, Severity, outlier_rows
from pouring_robot.campaign.frames import FrameFit, fit_frames
from pouring_robot.campaign.metadata import CampaignMetadata
from pouring_robot.campaign.nominal import PoseStack, nominal_poses, planar_poses, rotation_matrices, rotation_vectors
from pouring_robot.campaign.plan import PosePlan, random_plan, read_plan
from pouring_robot.campaign.reader import read_campaign
from pouring_robot.campaign.simulate import MeasurementOptions, VirtualMeasurement, simulate_campaign
from pouring_robot.campaign.writer import write_campaign

__all__ = [
    "DRIVE_JOINTS",
    "Block",
    "BlockKind",
    "Campaign",
    "CampaignMetadata",
    "DataFlag",
    "Examination",
    "FlagCode",
    "FrameFit",
    "MeasurementOptions",
    "PosePlan",
    "PoseStack",
    "Severity",
    "VirtualMeasurement",
    "check_campaign",
    "examine",
    "fit_frames",
    "nominal_poses",
    "outlier_rows",
    "planar_poses",
    "random_plan",
    "read_campaign",
    "read_plan",
    "rotation_matrices",
    "rotation_vectors",
    "simulate_campaign",
    "write_campaign",
]
