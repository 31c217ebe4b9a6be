"""A campaign in figures: what is in it, over which ranges, and what the checks found."""

from collections import Counter
from typing import Any

import numpy as np

from pouring_robot.campaign import columns
from pouring_robot.campaign.data import Campaign
from pouring_robot.checks.check import Examination
from pouring_robot.checks.columns import distinct_poses
from pouring_robot.checks.flags import outlier_rows
from pouring_robot.io.quantities import UNITS, Kind

_SHOWN_UNIT = {"length": ("mm", 1e3), "angle": ("rad", 1.0)}


def quantity_range(campaign: Campaign, name: str, kind: Kind) -> dict[str, Any] | None:
    """Return unit, least and largest value and number of missing cells of a quantity; None when it is absent.

    Lengths are in mm (the truss's travel in m), angles in rad, the rest in kg, s and °C.
    """
    values = campaign.command(name)
    if values is None or not np.isfinite(values).any():
        return None
    unit, factor = _SHOWN_UNIT.get(kind, (next(iter(UNITS[kind]), ""), 1.0))
    if name in campaign.robot.travels:
        unit, factor = "m", 1.0
    known = values[np.isfinite(values)] * factor
    return {
        "unit": unit,
        "least": float(known.min()) if known.size else None,
        "largest": float(known.max()) if known.size else None,
        "missing": int(values.size - known.size),
    }


def campaign_metrics(campaign: Campaign, found: Examination) -> dict[str, Any]:
    """Return everything a user should know of a campaign before a fit, ready for JSON; units are in the names."""
    metadata, fit = campaign.metadata, found.fit
    numeric = [quantity for quantity in columns.campaign_columns(campaign.robot) if quantity.kind != "label"]
    ranges = {quantity.name: quantity_range(campaign, quantity.name, quantity.kind) for quantity in numeric}
    figures: dict[str, Any] = {
        "file": str(campaign.path),
        "rows": len(campaign),
        "usable_rows": int(campaign.usable.sum()),
        "distinct_poses": distinct_poses(campaign),
        "sessions": dict(Counter(campaign.sessions)),
        "full_pose": campaign.full_pose,
        "seen": campaign.seen,
        "ranges": {name: values for name, values in ranges.items() if values is not None},
        "missing_conditions": list(campaign.missing_conditions()),
        "metadata": metadata.model_dump(mode="json"),
        "outlier_rows": outlier_rows(found.flags).tolist(),
        "flags": [flag.to_json(campaign) for flag in found.flags],
        "misfit": None,
        "redundant_drives_disagree_mm": found.disagreement_m and found.disagreement_m * 1e3,
        "untold_of_the_frames": [] if fit is None else list(fit.untold),
    }
    if fit is not None:
        rotation = fit.rotation_scale_rad
        figures["misfit"] = {
            "position_mm": fit.position_scale_m * 1e3,
            "position_noise_mm": metadata.sigma_position_m and metadata.sigma_position_m * 1e3,
            "rotation_mrad": None if rotation is None else rotation * 1e3,
            "rotation_noise_mrad": metadata.sigma_rotation_rad and metadata.sigma_rotation_rad * 1e3,
        }
    return figures
