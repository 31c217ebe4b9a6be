"""Where the noise of a campaign comes from: its metadata state it, or repeats show it, or a fit is to."""

from pouring_robot.campaign.data import Campaign
from pouring_robot.estimation.kinds import KINDS, Kind
from pouring_robot.estimation.noise import Noise, NoiseLevel
from pouring_robot.estimation.repeats import repeat_noise, repeats
from pouring_robot.estimation.residuals import MeasuredPoses
from pouring_robot.mechanism.arrays import Indices


def noise_beforehand(campaign: Campaign, rows: Indices) -> NoiseLevel:
    """Return the noise that metadata, or repeats among some rows, tell; else a first guess, to be fitted."""
    measured, facts = MeasuredPoses.from_campaign(campaign, NoiseLevel({})), campaign.metadata
    stated = (facts.sigma_position_m, facts.sigma_rotation_rad, facts.sigma_distance_m, facts.sigma_closure_m)
    scatter = (*repeat_noise(measured, repeats(campaign, rows)), None, None)
    there = {instrument.kind for instrument in measured.instruments if instrument.known.any()}
    found: dict[Kind, Noise] = {}
    for kind, given, seen in zip(KINDS, stated, scatter, strict=True):
        noise = seen or Noise(source="residuals") if given is None else Noise(given, "stated")
        found[kind] = noise if kind in there else Noise(noise.sigma)
    return NoiseLevel(found)
