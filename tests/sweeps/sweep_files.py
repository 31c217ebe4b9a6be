"""Small sweep files for the tests."""

import copy
from pathlib import Path

import yaml

BASE = {
    "format": "pouring_robot/sweep/1",
    "layout": "paper",
    "study": "monte_carlo",
    "poses": {"grid": {"y": 2, "z": 2, "tilt": 2}},
    "errors": [
        {
            "parameters": ["alpha_e*_*", "theta_e1_*"],
            "distribution": "truncated_normal",
            "std_mrad": 0.2,
            "limit_mrad": 0.5,
            "correlation": 0.4,
        },
        {"parameters": ["a_e*_*", "leg2_s1.t?"], "half_width_mm": 0.2},
        {"parameters": "drive.*", "distribution": "normal", "std_mm": 0.05, "std_mrad": 0.05},
    ],
    "samples": 40,
    "seed": 11,
    "chunk": 64,
}


def content(**changes):
    """Return the base file with some keys changed; None takes a key out."""
    merged = copy.deepcopy(BASE) | changes
    return {key: value for key, value in merged.items() if value is not None}


def write(folder, name="sweep.yaml", **changes):
    """Write it and return its path."""
    path = Path(folder) / name
    path.write_text(yaml.safe_dump(content(**changes), sort_keys=False), encoding="utf-8")
    return path


def snapshot(folder):
    """Return every file below a folder with its bytes."""
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(Path(folder).rglob("*")) if p.is_file()}


def numbers(folder):
    """Return the bytes of every array of a store; its half-written files do not count."""
    files = snapshot(Path(folder) / "results.zarr")
    return {name: data for name, data in files.items() if not name.endswith(".partial")}
