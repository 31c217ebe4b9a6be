"""An effect of one's own: screws that are worn where the nut stands most of the time."""

import numpy as np

from pouring_robot.effects import Conditions, Effect, EffectParameter, Form

PLACES_M = (0.5, 0.6, 0.7)
"""Leg lengths at which the nut may have stood most: one form each."""
WIDTH_M = 0.05
MM = 1e-3


class ScrewWear(Effect):
    """Legs 1 to 3 are wrong by a bell-shaped course of their length."""

    id = "screw_wear"
    story = "the screws are worn where the nut stands most of the time"
    robots = ("pouring_robot",)
    driven_by = "lengths_m"

    def forms(self, conditions: Conditions) -> tuple[Form, ...]:
        """Return one form for each place; its parameters are the errors there of l1, l2, l3 in mm."""
        found = []
        for place_m in PLACES_M:
            worn = MM * np.exp(-(((conditions.lengths_m - place_m) / WIDTH_M) ** 2))
            parameters = (
                EffectParameter(f"l{k + 1}_wear", "mm", prior_std=0.3, changes={f"drive.leg{k + 1}_s3": worn[:, k]})
                for k in range(3)
            )
            found.append(Form(f"at_{1e3 * place_m:.0f}_mm", tuple(parameters)))
        return tuple(found)
