"""What a calibration found: the data that lines, figures, plots and report are made of."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pouring_robot.calibration.metrics import LadleUncertainty, Misfit, PosePerformance
from pouring_robot.calibration.selection import Refusal, Selection
from pouring_robot.campaign.data import Campaign
from pouring_robot.checks.flags import DataFlag
from pouring_robot.estimation.identifiability import BaseParameters
from pouring_robot.estimation.map_fit import Fit
from pouring_robot.estimation.noise_level import NoiseLevel
from pouring_robot.estimation.splits import Split
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.robot.model import RobotModel
from pouring_robot.robot.parameters import ParameterGroup


@dataclass(frozen=True, eq=False)
class CalibrationFindings:
    """A calibrated robot and everything that says how far to trust it."""

    campaign: Campaign
    present: RobotModel  # the robot before; ``calibrated`` after: what to export
    calibrated: RobotModel
    flags: tuple[DataFlag, ...]  # what the checks of the data found
    left_out: NDArray[np.intp]  # rows that took no part: outliers, and poses or drives out of reach
    split: Split  # who was held out when
    noise: NoiseLevel
    candidates: tuple[ParameterGroup, ...]  # the groups that were to choose from
    selection: Selection  # the groups kept and what was tried
    refused: Refusal | None  # what was chosen, but made held-out rows worse and is not kept; None: nothing
    fit: Fit  # the answer, to all training rows with the groups kept; its covariance is at the noise level as given
    inflation: float  # factor on all standard deviations where the residuals are larger than the noise; 1 where not
    unknown_names: tuple[str, ...]  # name of each unknown, frames first; ``unknown_units`` its unit
    unknown_units: tuple[str, ...]
    # measured minus predicted by the present robot with its frames fitted to the training rows; all rows, shape (n, 6),
    # in m and rad, tracker axes; NaN where missing. ``after`` by the calibrated robot.
    before: FloatArray
    after: FloatArray
    base: BaseParameters  # what the training rows can tell of the groups kept, at the present robot
    rank_anywhere: int  # its rank if poses all over the workspace were measured besides, and the same way
    ladle: LadleUncertainty
    performance: PosePerformance | None  # ISO 9283-style figures; None without repeats

    @property
    def std(self) -> FloatArray:
        """Standard deviation of each unknown, shape (12 + P,), in m and rad, inflation included."""
        return self.fit.std * self.inflation

    @property
    def correlation(self) -> FloatArray:
        """Correlation of the unknowns, shape (12 + P, 12 + P)."""
        return np.asarray(self.fit.covariance / np.outer(self.fit.std, self.fit.std))

    @property
    def changed(self) -> bool:
        """Whether any parameter was kept."""
        return bool(self.selection.groups)

    def misfit(self, rows: NDArray[np.intp], *, after: bool) -> Misfit:
        """Return the misfit over rows, those left out excluded."""
        return Misfit.of((self.after if after else self.before)[np.setdiff1d(rows, self.left_out)])
