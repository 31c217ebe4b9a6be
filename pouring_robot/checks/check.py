"""All checks of a campaign before any fit; a new one is a function of this room, called in :func:`examine`."""

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from pouring_robot.campaign import columns
from pouring_robot.campaign.data import Campaign
from pouring_robot.campaign.nominal import nominal_poses
from pouring_robot.checks.columns import check_columns, distinct_poses, without_copies
from pouring_robot.checks.conditions import check_conditions
from pouring_robot.checks.flags import DataFlag, FlagCode, Severity, undone, wrong_rows
from pouring_robot.checks.frames import FrameChecks, in_frames_of_their_own
from pouring_robot.checks.gross_errors import check_rows
from pouring_robot.checks.smooth_errors import Aligned
from pouring_robot.checks.stated_noise import check_noise
from pouring_robot.checks.stationary_target import held_rows
from pouring_robot.checks.thermometers import check_thermometers
from pouring_robot.checks.units_and_axes import Comparison, mistaken_distances
from pouring_robot.estimation.frames.fit import FrameFit
from pouring_robot.io.argument_checks import expect
from pouring_robot.io.threads import one_blas_thread
from pouring_robot.io.units import MM, MRAD, UNITS
from pouring_robot.mechanism.arrays import rms
from pouring_robot.robot.description.drawing import Drawing


@dataclass(frozen=True, eq=False)
class Examination:
    """What the checks found."""

    flags: list[DataFlag]  # the findings, errors first
    comparison: Comparison  # commands and measurements, mistakes found undone; copied rows have no commands
    fit: FrameFit | None  # the two frames fitted to them; None where they cannot be
    disagreement_m: float | None = None  # RMS disagreement of the nominal robot's redundant drives; None without any


@one_blas_thread()
def examine(campaign: Campaign, drawing: Drawing) -> Examination:
    """Run all checks and keep their intermediate results; see :func:`check_campaign`."""
    poses = nominal_poses(drawing, campaign.drives)
    found = list(check_columns(campaign, held_rows(campaign, drawing, poses)))
    campaign, moved = in_frames_of_their_own(campaign, poses)
    found += moved
    campaign = without_copies(campaign)
    frames = FrameChecks(campaign, drawing)
    found += [*frames.flags, *check_conditions(campaign, drawing, frames.data.drives)]
    found += [*check_thermometers(campaign), *mistaken_distances(campaign, frames.data.poses)]
    if frames.fit is not None:
        aligned = Aligned(campaign, drawing, frames.data, frames.fit)
        found += check_rows(aligned)
        if not any(flag.severity is Severity.ERROR for flag in found):  # an error alone makes the rows scatter
            found += check_noise(aligned, wrong_rows(found))
    order = list(Severity)
    # Too small a stated noise makes chance findings: it is reported before others of its severity.
    flags = sorted(found, key=lambda flag: (order.index(flag.severity), flag.code != FlagCode.NOISE_TOO_SMALL))
    disagreement, drives = None, frames.data.drives
    if campaign.redundant_drives:
        closed = drawing.engine.close(drives, drawing.starts(drives))
        disagreement = rms(closed.disagreement[campaign.usable])
    return Examination(flags, frames.data, frames.fit, disagreement)


def check_campaign(campaign: Campaign, drawing: Drawing | None = None) -> list[DataFlag]:
    """Return what is wrong with a campaign's data, errors first; an empty list for sound data.

    They are compared with the nominal robot, by default the campaign's; errors of the robot as built do not matter
    here. Raises BadInputError where there is no campaign.
    """
    expect(campaign, Campaign, "a check takes a Campaign, such as Campaign.read returns")
    return examine(campaign, drawing or campaign.robot.drawing()).flags


def campaign_metrics(campaign: Campaign, found: Examination) -> dict[str, Any]:
    """Return everything a user should know about a campaign before a fit, ready for JSON; units are in the names."""
    metadata, fit, wrong = campaign.metadata, found.fit, wrong_rows(found.flags)
    figures: dict[str, Any] = {
        "file": str(campaign.path),
        "rows": len(campaign),
        "usable_rows": int(np.setdiff1d(np.flatnonzero(campaign.usable), wrong).size),
        "distinct_poses": distinct_poses(campaign),
        "sessions": dict(Counter(campaign.sessions)),
        "full_pose": campaign.full_pose,
        "seen": campaign.seen,
        "ranges": dict(_ranges(campaign)),
        "missing_conditions": list(campaign.missing_conditions()),
        "metadata": metadata.model_dump(mode="json"),
        "outlier_rows": wrong.tolist(),
        "flags": [flag.figures(campaign) for flag in found.flags],
        "undone": undone(found.flags),
        "misfit": None,
        "redundant_drives_disagree_mm": found.disagreement_m and found.disagreement_m / MM,
        "untold_of_the_frames": [] if fit is None else list(fit.undetermined),
    }
    if fit is not None:
        rotation = fit.rotation_scale_rad
        figures["misfit"] = {
            "position_mm": fit.position_scale_m / MM,
            "position_noise_mm": metadata.sigma_position_m and metadata.sigma_position_m / MM,
            "rotation_mrad": None if rotation is None else rotation / MRAD,
            "rotation_noise_mrad": metadata.sigma_rotation_rad and metadata.sigma_rotation_rad / MRAD,
        }
    return figures


def _ranges(campaign: Campaign) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield unit, least and largest value and number of missing cells of each recorded quantity.

    Lengths are in mm (a travel in m), angles in rad, the rest in kg, s and °C.
    """
    for quantity in columns.campaign_columns(campaign.robot):
        values = None if quantity.kind == "label" else campaign.command(quantity.name)
        if values is not None and np.isfinite(values).any():
            shown = {} if quantity.name in campaign.robot.travels else {"length": ("mm", 1e3)}
            unit, factor = shown.get(quantity.kind, (next(iter(UNITS[quantity.kind]), ""), 1.0))
            known = values[np.isfinite(values)] * factor
            ends = {"least": float(known.min()), "largest": float(known.max())}
            yield quantity.name, {"unit": unit, **ends, "missing": int(values.size - known.size)}
