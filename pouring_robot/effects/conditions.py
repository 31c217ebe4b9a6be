"""What effects may depend on, row by row: commands, loads, temperatures, time. From a campaign and the drawing.

Forces follow from virtual work: a drive that yields by dq under the weight W at height h carries -W ∂h/∂q.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pouring_robot.campaign.columns import approach_names
from pouring_robot.campaign.data import Campaign
from pouring_robot.io.temperatures import REFERENCE_DEGC
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.closed_chain import GRAVITY_M_S2
from pouring_robot.robot.pouring.names import LEGS


@dataclass(frozen=True, eq=False)
class Conditions:
    """n rows in SI units; None where a campaign does not say.

    Attributes:
        drives: commanded drives, (n, 4), in m and rad.
        lengths_m: distances between the U-joint centres of all four legs, (n, 4).
        position_m: nominal origin of the moving platform in the fixed platform, (n, 3).
        rotation: nominal axes of the moving platform, (n, 3, 3).
        lean_rad: angle of the first joint of every leg, (n, 4).
        lower_centres_m: lower U-joint centres in the moving platform, (4, 3).
        session: number of the session from 0, (n,).
        time_s: time of measurement, (n,); without a time column the number of the row stands for it.
        time_known: whether there was a time column.
        approach: side each drive was approached from, (n, 4), +1 or -1.
        weight_n: weight of ladle and melt, (n,).
        leg_pull_n: tension that weight puts into legs 1 to 3, (n, 3); leg 4 is passive.
        tilt_moment_nm: moment that weight puts on the tilt drive, (n,).
        truss_travel_m: place along the rails, (n,).
        melt_rise_k: melt above the reference temperature, (n,).
        ambient_rise_k: hall above the reference temperature, (n,).
        leg_rise_k: legs above the reference temperature, (n, 4).
        platform_rise_k: moving platform above the reference temperature, (n,).
        screw_pitch_m: travel of a leg a turn.
        truss_span_m: length of the rails.
        filled: conditions of which single cells were missing and were filled in from their neighbours in time.
        assumed: what was assumed, one line each.
    """

    drives: FloatArray
    lengths_m: FloatArray
    position_m: FloatArray
    rotation: FloatArray
    lean_rad: FloatArray
    lower_centres_m: FloatArray
    session: NDArray[np.intp]
    time_s: FloatArray
    time_known: bool
    approach: FloatArray | None = None
    weight_n: FloatArray | None = None
    leg_pull_n: FloatArray | None = None
    tilt_moment_nm: FloatArray | None = None
    truss_travel_m: FloatArray | None = None
    melt_rise_k: FloatArray | None = None
    ambient_rise_k: FloatArray | None = None
    leg_rise_k: FloatArray | None = None
    platform_rise_k: FloatArray | None = None
    screw_pitch_m: float | None = None
    truss_span_m: float | None = None
    filled: tuple[str, ...] = ()
    assumed: tuple[str, ...] = ()

    def __len__(self) -> int:
        """Return the number of rows."""
        return len(self.drives)

    @property
    def tilt_rad(self) -> FloatArray:
        """Nominal tilt of the platform, (n,)."""
        return np.asarray(np.arctan2(self.rotation[:, 0, 2], self.rotation[:, 2, 2]))

    @property
    def tilt_drive_rad(self) -> FloatArray:
        """Commanded angle of the tilt drive, (n,)."""
        return self.drives[:, 3]

    @property
    def passed(self) -> FloatArray:
        """How much of the campaign's time has passed, 0 to 1, (n,)."""
        return np.asarray((self.time_s - self.time_s.min()) / max(float(np.ptp(self.time_s)), 1e-9))

    def behind(self, values: FloatArray, lag_s: float) -> FloatArray:
        """Return values (n,) or (n, k) that follow given ones with a time constant, in the order of time."""
        out = np.array(values, dtype=float)
        order = np.argsort(self.time_s, kind="stable")
        for before, now in itertools.pairwise(order):
            kept = np.exp(-(self.time_s[now] - self.time_s[before]) / lag_s)
            out[now] = values[now] + (out[before] - values[now]) * kept
        return out


@dataclass(frozen=True, eq=False)
class NominalRows:
    """What the drawing says of the rows of a campaign.

    Attributes:
        position_m: origin of the moving platform, (n, 3).
        rotation: its axes, (n, 3, 3).
        joints: joint values by chain, (n, chains, joints), in m and rad.
        by_drive: ∂pose/∂drive, (n, 6, 4).
        lower_centres_m: lower U-joint centres in the moving platform, (4, 3).
    """

    position_m: FloatArray
    rotation: FloatArray
    joints: FloatArray
    by_drive: FloatArray
    lower_centres_m: FloatArray


def conditions_of(campaign: Campaign, nominal: NominalRows) -> Conditions:
    """Return the conditions of a campaign.

    Args:
        campaign: the data; all its rows are usable.
        nominal: the same rows by the drawing.
    """
    filler = _Filler(campaign)
    metadata = campaign.metadata
    reference = metadata.reference_temperature_degC
    assumed = []
    if reference is None:
        reference = REFERENCE_DEGC
        assumed.append(f"reference temperature {reference:g} °C")
    payload = filler("payload")
    weight = pull = moment = None
    if payload is not None and metadata.ladle_tare_kg is not None and metadata.ladle_centre_of_mass_m is not None:
        weight = (metadata.ladle_tare_kg + payload) * GRAVITY_M_S2
        arm = nominal.rotation @ np.array(metadata.ladle_centre_of_mass_m)
        turn = nominal.by_drive[:, 3:]
        rise = nominal.by_drive[:, 2] + arm[:, 1, None] * turn[:, 0] - arm[:, 0, None] * turn[:, 1]
        pull, moment = -weight[:, None] * rise[:, :3], -weight * rise[:, 3]
    known = filler("time")
    names = {name: k for k, name in enumerate(dict.fromkeys(campaign.sessions))}
    above = {name: filler(name) for name in ("melt", "ambient", "platform")} | {"leg": filler(*LEGS)}
    rises = {f"{name}_rise_k": None if v is None else v - reference for name, v in above.items()}
    return Conditions(
        drives=np.array(campaign.drives),
        lengths_m=nominal.joints[:, :, 2],
        position_m=nominal.position_m,
        rotation=nominal.rotation,
        lean_rad=nominal.joints[:, :, 0],
        lower_centres_m=nominal.lower_centres_m,
        session=np.array([names[name] for name in campaign.sessions], dtype=np.intp),
        time_s=np.arange(len(campaign), dtype=float) if known is None else known,
        time_known=known is not None,
        approach=filler(*approach_names(campaign.robot)),
        weight_n=weight,
        leg_pull_n=pull,
        tilt_moment_nm=moment,
        truss_travel_m=filler("truss_travel"),
        screw_pitch_m=metadata.screw_pitch_m,
        truss_span_m=metadata.truss_span_m,
        filled=tuple(filler.filled),
        assumed=tuple(assumed),
        **rises,
    )


class _Filler:
    """Reads arrays of a campaign and fills single missing cells from their neighbours in time."""

    def __init__(self, campaign: Campaign) -> None:
        self._campaign = campaign
        time = campaign.time_s
        whole = time is not None and bool(np.isfinite(time).all())
        self._time = np.asarray(time) if whole else np.arange(len(campaign), dtype=float)
        self.filled: list[str] = []

    def __call__(self, *names: str) -> FloatArray | None:
        """Return quantities without gaps, (n,) or a column each; None where the campaign lacks one of them."""
        given = [self._campaign.quantity(name) for name in names]
        columns = [self._without_gaps(n, v) for n, v in zip(names, given, strict=True) if v is not None]
        if len(columns) < len(names):
            return None
        return columns[0] if len(names) == 1 else np.column_stack(columns)

    def _without_gaps(self, name: str, values: FloatArray) -> FloatArray:
        known = np.isfinite(values)
        if known.all():
            return values
        order = np.argsort(self._time[known], kind="stable")
        times, cells = self._time[known][order], values[known][order]
        filled = np.interp(self._time[~known], times, cells)
        whole = np.array(values)
        whole[~known] = np.sign(filled) + (filled == 0.0) if name.startswith("approach_") else filled
        self.filled.append(self._campaign.heading(name))
        return whole
