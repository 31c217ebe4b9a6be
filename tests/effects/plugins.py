"""Packages with effects, placed where Python finds packages, without installing anything."""

import tomllib

from tests.support import ROOT

EXAMPLE = ROOT / "examples" / "plugin_effect"
GROUP = "pouring_robot.effects"


def installed(folder, name, module, entry_points):
    """Write a package by hand as an installer leaves it: a module and its ``.dist-info``."""
    info = folder / f"{name}-1.0.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n", encoding="utf-8")
    lines = [f"[{GROUP}]", *(f"{entry} = {value}" for entry, value in entry_points.items())]
    (info / "entry_points.txt").write_text("\n".join(lines) + "\n", encoding="utf-8")
    (folder / f"{name}.py").write_text(module, encoding="utf-8")
    return folder


def installed_example(folder):
    """Return a folder that holds the example package as an installer leaves it, by its own pyproject."""
    project = tomllib.loads((EXAMPLE / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    module = (EXAMPLE / "screw_wear.py").read_text(encoding="utf-8")
    return installed(folder, project["name"], module, project["entry-points"][GROUP])
