"""Conditions held such that two effects coincide, as it happens in a workshop."""

import numpy as np

from tests.examiner.machine import drives_of


def from_below(rng, scene):
    """All poses approached from below: lost motion is a shift of the reference."""
    scene.approach[:] = 1.0
    return "drive_backlash"


def soaked(rng, scene):
    """Measured after a day under the same heat: growth is lead error, or scale."""
    scene.legs[:] = rng.uniform(60, 200) + 0.1 * rng.normal(size=scene.legs.shape)
    scene.platform[:] = rng.uniform(60, 200) + 0.1 * rng.normal(size=scene.platform.shape)
    return str(rng.choice(["leg_thermal_expansion", "platform_thermal_expansion"]))


def one_pour(rng, scene):
    """One pour at one station, at a steady rate: the rails rise with the clock."""
    u = (scene.time - scene.time[0]) / np.ptp(scene.time)
    scene.payload[:] = (1 - u) * max(scene.payload.max(), 100.0)
    scene.travel[:] = rng.uniform(0.2, 0.8) * scene.span
    return "truss_deflection"


def locked_tilt(rng, scene):
    """The tilt drive locked in one place: an eccentric disc is a turned one."""
    held = rng.uniform(-0.6, 0.2) + rng.uniform(-0.01, 0.01, size=len(scene.pose))
    for _ in range(20):
        scene.pose[:, 3] += held - drives_of(scene.pose)[:, 3]
    scene.drives[:] = drives_of(scene.pose)
    return "tilt_encoder_eccentricity"


RECIPES = (from_below, soaked, one_pour, locked_tilt)


def arrange(rng, scene, index):
    """Change the scene by the recipe of that number, in place; return the effect to hide in it."""
    return RECIPES[index % len(RECIPES)](rng, scene)
