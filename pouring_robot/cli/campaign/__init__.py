"""``pouring-robot campaign``: choose what to measure, check what was measured, measure a virtual robot."""

from pouring_robot.cli.campaign.check import check
from pouring_robot.cli.campaign.plan import plan
from pouring_robot.cli.campaign.simulate import simulate
from pouring_robot.cli.shared.bundles import group_of

campaign = group_of(
    "Measurement campaigns: choose what to measure, check the data, or measure a virtual robot.",
    [plan, check, simulate],
)
