"""Effects of heat: legs and moving platform grow. Thermometers are biased and lag; forms allow for it."""

from __future__ import annotations

import numpy as np

from pouring_robot.effects.base import Effect, EffectParameter, Form
from pouring_robot.effects.conditions import Conditions
from pouring_robot.effects.drives import CHANNELS, LEGS, of_legs
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.robot.pouring.names import SEATS

_PPM = 1e-6
_PRIOR_STD_PPM = 12.0
_BIAS_K = 4.0
_GAIN = 0.03
_LAG_S = 500.0


class LegThermalExpansion(Effect):
    """Legs longer with their temperature."""

    id = "leg_thermal_expansion"
    story = "warm legs are longer than the controller believes"
    needs = ("leg_rise_k",)

    def forms(self, conditions: Conditions) -> tuple[Form, ...]:
        """Each leg as a whole with its thermometer, which may be biased, lag, or see another part of the leg."""
        lengths, rise = conditions.lengths_m[:, :3], np.asarray(conditions.leg_rise_k)[:, :3]
        prior_std = _PRIOR_STD_PPM
        main = EffectParameter("expansion", "1e-6/K", prior_std, of_legs(_PPM, lengths * rise), bounds=(0.0, np.inf))
        late = lengths * (conditions.behind(rise, _LAG_S) - rise)
        shape = [
            EffectParameter("barrel", "1e-6 m/K", 0.3 * prior_std, of_legs(_PPM, 0.3 * rise), main=False),
            EffectParameter("lag", "1e-6/K", 0.7 * prior_std, of_legs(_PPM, late), main=False),
        ]
        if conditions.platform_rise_k is not None:
            nearer = of_legs(_PPM, lengths * (conditions.platform_rise_k[:, None] - rise))
            shape.append(EffectParameter("platform_share", "1e-6/K", 0.2 * prior_std, nearer, main=False))
        for k in LEGS:
            bias, gain = {CHANNELS[k]: _PPM * lengths[:, k]}, {CHANNELS[k]: _PPM * lengths[:, k] * rise[:, k]}
            shape.append(EffectParameter(f"l{k + 1}_thermometer_bias", "1e-6", _BIAS_K * prior_std, bias, main=False))
            shape.append(EffectParameter(f"l{k + 1}_thermometer_gain", "1e-6/K", _GAIN * prior_std, gain, main=False))
        return (Form("own_temperature", (main, *shape)),)


class PlatformThermalExpansion(Effect):
    """Moving platform grows."""

    id = "platform_thermal_expansion"
    story = "the warm moving platform carries its U joints further apart than drawn"
    needs = ("platform_rise_k",)

    def forms(self, conditions: Conditions) -> tuple[Form, ...]:
        """Evenly about its origin; perhaps less along x, with a biased thermometer, or later than its skin."""
        rise, prior_std = np.asarray(conditions.platform_rise_k), _PRIOR_STD_PPM
        centres = conditions.lower_centres_m

        def grown(values: FloatArray, axes: str = "xyz") -> dict[str, FloatArray]:
            return {
                f"{seat}.t{axis}": _PPM * values * centre["xyz".index(axis)]
                for seat, centre in zip(SEATS, centres, strict=True)
                for axis in axes
            }

        one = np.ones(len(conditions))
        late = conditions.behind(rise, _LAG_S) - rise
        return (
            Form(
                "even",
                (
                    EffectParameter("expansion", "1e-6/K", prior_std, grown(rise), bounds=(0.0, np.inf)),
                    EffectParameter("along_x", "1e-6/K", 0.3 * prior_std, grown(rise, "x"), main=False),
                    EffectParameter("thermometer_bias", "1e-6", _BIAS_K * prior_std, grown(one), main=False),
                    EffectParameter("lag", "1e-6/K", 0.7 * prior_std, grown(late), main=False),
                ),
            ),
        )
