"""All checks of a campaign before any fit."""

from dataclasses import dataclass

from pouring_robot.batch import engine_for
from pouring_robot.campaign.data import Campaign
from pouring_robot.campaign.nominal import nominal_poses
from pouring_robot.checks.columns import check_columns
from pouring_robot.checks.conditions import check_conditions
from pouring_robot.checks.flags import DataFlag, FlagCode, Severity, outlier_rows
from pouring_robot.checks.frames import FrameChecks
from pouring_robot.checks.noise import check_noise
from pouring_robot.checks.outliers import check_rows
from pouring_robot.checks.sessions import in_frames_of_their_own
from pouring_robot.checks.units_and_axes import Comparison
from pouring_robot.estimation.frames.fit import FrameFit
from pouring_robot.io.threads import one_blas_thread
from pouring_robot.mechanism.arrays import FloatArray, rms
from pouring_robot.robot.description.drawing import Drawing


@dataclass(frozen=True, eq=False)
class Examination:
    """What the checks found.

    Attributes:
        flags: the findings, errors first.
        comparison: commands and measurements with the mistakes found undone.
        fit: the two frames fitted to them; None where they cannot be.
        disagreement_m: root mean square of what redundant drives of the nominal robot disagree by, in m; None without.
    """

    flags: list[DataFlag]
    comparison: Comparison
    fit: FrameFit | None
    disagreement_m: float | None = None


@one_blas_thread()
def examine(campaign: Campaign, drawing: Drawing) -> Examination:
    """Run all checks and keep what they found on the way; see :func:`check_campaign`."""
    poses = nominal_poses(drawing, campaign.drives)
    campaign, found = in_frames_of_their_own(campaign, poses)
    found += check_columns(campaign)
    frames = FrameChecks(campaign, drawing)
    found += [*frames.flags, *check_conditions(campaign, drawing, frames.data.drives)]
    if frames.fit is not None:
        found += check_rows(campaign, drawing, frames.data, frames.fit)
        if not any(flag.severity is Severity.ERROR for flag in found):  # an error scatters the rows by itself
            found += check_noise(campaign, drawing, frames.data, frames.fit, outlier_rows(found))
    order = list(Severity)
    # Too small a noise makes findings of chance: it is said before anything else of its kind.
    flags = sorted(found, key=lambda flag: (order.index(flag.severity), flag.code != FlagCode.NOISE_TOO_SMALL))
    return Examination(flags, frames.data, frames.fit, _disagreement(campaign, drawing, frames.data.drives))


def _disagreement(campaign: Campaign, drawing: Drawing, drives: FloatArray) -> float | None:
    if not campaign.redundant_drives:
        return None
    apart = engine_for(drawing.mechanism).close(drives, drawing.starts(drives)).disagreement[campaign.usable]
    return rms(apart)


def check_campaign(campaign: Campaign, drawing: Drawing) -> list[DataFlag]:
    """Return what is wrong with a campaign's data, errors first; an empty list for sound data.

    The nominal robot is compared with them: errors of the robot as built do not matter here.
    """
    return examine(campaign, drawing).flags
