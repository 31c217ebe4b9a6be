"""Synthetic campaigns for the tests: simulated once, then damaged by hand."""

import dataclasses

import numpy as np

from pouring_robot.campaign.plan import random_plan
from pouring_robot.campaign.simulate import MeasurementOptions, simulate_campaign

SIGMA_M, SIGMA_RAD = 5e-5, 5e-5


def measure(robot, count=60, seed=1, **options):
    """Return a virtual measurement with the default noise."""
    settings = {"sigma_position_m": SIGMA_M, "sigma_rotation_rad": SIGMA_RAD, "seed": seed} | options
    return simulate_campaign(robot, random_plan(robot, count, seed), MeasurementOptions(**settings))


def damaged(campaign, **changes):
    """Return the campaign with arrays or conditions changed by functions of a copy, or replaced."""
    replaced, conditions = {}, {}
    for name, change in changes.items():
        there = conditions if name in campaign.conditions else replaced
        if callable(change):
            values = np.array(campaign.conditions[name] if there is conditions else getattr(campaign, name))
            result = change(values)
            there[name] = values if result is None else result
        else:
            there[name] = change
    return dataclasses.replace(campaign, **replaced).with_conditions(**conditions)


def codes(flags):
    """Return the codes of the findings as plain strings."""
    return {str(flag.code) for flag in flags}


def write_text(folder, header, rows, metadata="", name="c"):
    """Write a small campaign as text and return its table's path."""
    table = folder / f"{name}.csv"
    table.write_text("\n".join([header, *rows]) + "\n", encoding="utf-8")
    (folder / f"{name}.yaml").write_text(metadata or MINIMAL_YAML, encoding="utf-8")
    return table


MINIMAL_YAML = "metrology: {sigma_position_mm: 0.05, sigma_rotation_rad: 5.0e-5}\n"
