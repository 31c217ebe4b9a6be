"""The dimensions file: its layouts, and the URDF made from one; its schema is in ``layout_schema``.

The URDF is the source of the geometry; xacro makes it from the dimensions file. This module checks the file before
xacro reads it (a misspelt key, a negative size or a NaN is refused with file, line and key), including what a URDF
cannot hold: the workspace, the ladle's payload, the required accuracy.

A file that is missing or wrong raises DescriptionError, which names file, line and key; a layout that is not in it
raises UnknownLayoutError.
"""

import importlib.metadata
import math
import reprlib
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path

import numpy as np
import yaml

from pouring_robot.exceptions import DescriptionError, UnknownLayoutError
from pouring_robot.io.cache import content_key, kept_text
from pouring_robot.io.files import read_text
from pouring_robot.io.typed_yaml import parse_yaml, validate
from pouring_robot.robot.description.urdf import description_folder
from pouring_robot.robot.pouring import layout_schema
from pouring_robot.robot.pouring.layout_schema import Layout, LayoutsFile
from pouring_robot.robot.pouring.names import CHAINS, DEFAULT_LAYOUT

# YAML 1.1, as xacro reads it; the compiled loader where PyYAML has it.
_XACRO_LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
# The mesh consists of flat facets, so its outline is up to 0.3 % inside the true one.
_MESH_TOLERANCE = 0.005


def shipped_layouts_file() -> Path:
    """Return the dimensions file that comes with the package."""
    return description_folder() / "config" / "layouts.yaml"


def layout_names(layouts_file: Path | None = None) -> tuple[str, ...]:
    """Return the names of the layouts in a dimensions file (default: the shipped one), in the file's order."""
    path = layouts_file or shipped_layouts_file()
    return tuple(_parse(path, read_text(path)).layouts)


def load_layout(name: str = DEFAULT_LAYOUT, layouts_file: Path | None = None) -> Layout:
    """Return one layout of a dimensions file (default: the shipped one)."""
    path = layouts_file or shipped_layouts_file()
    return _layout_in(path, read_text(path), name)


def _layout_in(path: Path, text: str, name: str) -> Layout:
    layouts = _parse(path, text).layouts
    if name not in layouts:
        raise UnknownLayoutError(name, tuple(layouts), path)
    return layouts[name]


@lru_cache(maxsize=16)
def _parse(path: Path, text: str) -> LayoutsFile:
    """Return the checked file; its text is part of the cache key, so a changed file is read again."""

    def read() -> str:
        content = parse_yaml(text, path)
        try:
            _refuse_ambiguous(path, content, yaml.load(text, _XACRO_LOADER))
        except yaml.YAMLError as error:
            raise DescriptionError(path, f"not valid YAML for xacro: {error}") from error
        return validate(LayoutsFile, content, path).model_dump_json()

    # Reading YAML takes thirty times as long as reading JSON.
    key = content_key([text, read_text(Path(layout_schema.__file__))])
    return LayoutsFile.model_validate_json(kept_text(f"layouts/{key}.kept", read))


def _refuse_ambiguous(path: Path, ours: object, theirs: object, key: str = "") -> None:
    """Refuse a value that our reader (YAML 1.2) and xacro's (YAML 1.1) would interpret differently.

    `7.85e3` is a number for one and text for the other, `010` is ten for one and eight for the other.
    """
    if isinstance(ours, dict) and isinstance(theirs, dict):
        for name, value in ours.items():
            if name not in theirs:
                problem = f"YAML readers disagree on the name '{name}'"
                where = f"'{key}': " if key else ""
                raise DescriptionError(path, f"{where}{problem}; put it in quotes")
            _refuse_ambiguous(path, value, theirs.get(name), f"{key}.{name}".lstrip("."))
    elif isinstance(ours, list) and isinstance(theirs, list) and len(ours) == len(theirs):
        for index, (mine, other) in enumerate(zip(ours, theirs, strict=True)):
            _refuse_ambiguous(path, mine, other, f"{key}.{index}")
    elif ours != theirs and not (isinstance(ours, float) and math.isnan(ours)):
        problem = f"YAML readers disagree on this value ({reprlib.repr(ours)} or {reprlib.repr(theirs)})"
        raise DescriptionError(path, f"'{key}': {problem}; write numbers as 12.5 or 1.0e+5")


def stale_mesh_note(name: str, layouts_file: Path | None) -> str | None:
    """Return a note if the ladle's mesh differs in size from the dimensions file; otherwise None."""
    file = layouts_file or shipped_layouts_file()
    ladle = load_layout(name, file).ladle
    path = description_folder() / "meshes" / ladle.mesh.value
    if not path.is_file():  # reported when the mesh is drawn
        return None
    import trimesh  # takes half a second to import

    # In the frame ``ladle`` the vessel hangs below its rim (z = 0); the pouring lip projects towards +x.
    rim = ladle.outer_radius_top.metres + ladle.rim_flange.metres
    lip = max(rim, ladle.outer_radius_top.metres + ladle.lip_reach.metres)
    wanted = np.array([[-rim, -rim, -ladle.height.metres], [lip, rim, 0.0]])
    off = np.abs(trimesh.load_mesh(path).bounds - wanted).max()
    if off <= _MESH_TOLERANCE * np.abs(wanted).max():
        return None
    return (
        f"the ladle is drawn from {ladle.mesh.value}, which is {off * 1e3:.0f} mm off the dimensions in "
        f"{file.name}; rebuild it with scripts/make_meshes.py --layouts FILE (results are not affected)"
    )


def render_urdf(
    layout: str = DEFAULT_LAYOUT, *, chain_order: Sequence[int] = (1, 2, 3, 4), layouts_file: Path | None = None
) -> str:
    """Return the robot's URDF; safe to call from several threads.

    Rendering takes half a second. The result is cached on disk under a hash of everything it depends on, so a changed
    file is detected and an unchanged one is rendered once per machine.

    Args:
        layout: name of a layout in the dimensions file.
        chain_order: the four chains; the first carries the platform in the tree, the others close on it.
        layouts_file: dimensions file (default: the shipped one).

    Raises:
        DescriptionError: a file is wrong; names it and, where known, line and key.
        UnknownLayoutError: the layout is not in the dimensions file.
        ValueError: ``chain_order`` is not a permutation of 1, 2, 3, 4.
    """
    if sorted(chain_order) != list(CHAINS):
        raise ValueError(f"chain_order must hold 1, 2, 3 and 4 once each, not {tuple(chain_order)}")
    path = (layouts_file or shipped_layouts_file()).absolute()
    dimensions = read_text(path)
    _layout_in(path, dimensions, layout)
    folder = description_folder() / "urdf"
    arguments = {"layout": layout, "chains": " ".join(str(chain) for chain in chain_order)}
    parts = [f"{key}={value}" for key, value in arguments.items()]
    parts += [importlib.metadata.version("xacro"), *(read_text(file) for file in sorted(folder.glob("*.xacro")))]
    arguments["layouts_file"] = str(path)  # the key contains its text, not its path
    return _rendered(content_key([dimensions, *parts]), dimensions, folder, tuple(arguments.items()))


@lru_cache(maxsize=64)
def _rendered(key: str, dimensions: str, folder: Path, arguments: tuple[tuple[str, str], ...]) -> str:
    """Return the rendering for a cache key; an earlier process may have made it."""

    def render() -> str:
        from pouring_robot.robot.description.xacro_to_urdf import run_xacro

        path = Path(dict(arguments)["layouts_file"])
        urdf = run_xacro(folder / "pouring_robot.urdf.xacro", dict(arguments), [path])
        if read_text(path) != dimensions:  # xacro read a newer text: do not cache its output under the old key
            raise DescriptionError(path, "changed while it was read; run the command again")
        return urdf

    return kept_text(f"urdf/{key}.kept", render)
