"""What is to be added to a campaign so that an effect can be tested, in words."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from pouring_robot.campaign.data import Campaign
from pouring_robot.effects.facts import sources


def absent_sources(needs: Iterable[str], campaign: Campaign) -> tuple[str, ...]:
    """Return those of :func:`sources` that a campaign does not have."""
    columns = {*campaign.missing_conditions()}
    stated = {
        "ladle.tare_kg": campaign.metadata.ladle_tare_kg,
        "ladle.centre_of_mass_mm": campaign.metadata.ladle_centre_of_mass_m,
        "drives.screw_pitch_mm": campaign.metadata.screw_pitch_m,
        "truss.span_m": campaign.metadata.truss_span_m,
    }
    wanted = sources(needs)
    found = tuple(name for name in wanted if name in columns or (name in stated and stated[name] is None))
    return found or wanted


def source_text(names: Sequence[str], campaign: Campaign) -> str:
    """Return in words what is to be added to a campaign: columns to the table, keys to the YAML beside it."""
    keys = [name for name in names if "." in name]
    columns = [name for name in names if "." not in name]
    parts = [f"column{'s' if len(columns) > 1 else ''} {', '.join(columns)}"] if columns else []
    parts += [f"{', '.join(keys)} in {campaign.path.with_suffix('.yaml').name}"] if keys else []
    return " and ".join(parts)
