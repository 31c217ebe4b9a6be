"""The dimensions file: what Python needs of it, in SI units; its schema is ``layout_schema``.

The URDF is the source of the geometry; xacro makes it from the same file. This module checks the
file before xacro sees it (a misspelt key, a negative size, a NaN is refused with file, line and key). Then
it reads the few things a URDF cannot hold: the workspace, the ladle's payload, the required accuracy.
"""

import math
import reprlib
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
import yaml
from numpy.typing import ArrayLike, NDArray

from pouring_robot.exceptions import DescriptionError, UnknownLayoutError
from pouring_robot.io.cache import content_key, kept_text
from pouring_robot.io.typed_yaml import read_yaml, validate
from pouring_robot.mechanism.arrays import read_only
from pouring_robot.robot.description.urdf import description_folder, read_text
from pouring_robot.robot.pouring import layout_schema
from pouring_robot.robot.pouring.layout_schema import Ladle, LayoutEntry, LayoutsFile

# YAML 1.1, as xacro reads it; the compiled one where PyYAML has it.
_XACRO_LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


@dataclass(frozen=True)
class LadleDimensions:
    """The ladle in SI units; positions in the moving platform's frame.

    Attributes:
        payload_kg: largest mass of melt. It is a condition of a pose, not part of the URDF.
        tare_kg: mass of the empty ladle, as in the URDF.
        centre_of_mass_m: of the empty ladle.
        rim_centre_m: origin of the link ``ladle``.
        outer_radius_top_m, outer_radius_bottom_m, height_m, wall_m: the truncated cone.
        rim_flange_m, rim_flange_height_m: stiffening ring.
        lip_reach_m: pouring lip beyond the outer radius.
        lip_half_angle_rad: angular half width of the lip.
        melt_below_rim_m: level of a full ladle.
        mesh: file name of the mesh.
    """

    payload_kg: float
    tare_kg: float
    centre_of_mass_m: tuple[float, float, float]
    rim_centre_m: tuple[float, float, float]
    outer_radius_top_m: float
    outer_radius_bottom_m: float
    height_m: float
    wall_m: float
    rim_flange_m: float
    rim_flange_height_m: float
    lip_reach_m: float
    lip_half_angle_rad: float
    melt_below_rim_m: float
    mesh: str


@dataclass(frozen=True, eq=False)
class Layout:
    """What Python needs of one layout, in SI units. Arrays are read-only.

    Attributes:
        name: its name in the file.
        path: the file.
        position_lower_m, position_upper_m: (3,) workspace box of the moving platform's origin, in the
            fixed platform.
        tilt_lower_rad, tilt_upper_rad: its tilt about y.
        accuracy_m: required accuracy of the ladle.
        fixed_centres_m: (4, 3) upper U-joint centres A_i in the fixed platform.
        moving_centres_m: (4, 3) lower U-joint centres B_i in the moving platform.
        truss_span_m: length over which ``truss_travel`` runs.
        ladle: the ladle.
    """

    name: str
    path: Path
    position_lower_m: NDArray[np.float64]
    position_upper_m: NDArray[np.float64]
    tilt_lower_rad: float
    tilt_upper_rad: float
    accuracy_m: float
    fixed_centres_m: NDArray[np.float64]
    moving_centres_m: NDArray[np.float64]
    truss_span_m: float
    ladle: LadleDimensions

    @property
    def box(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Lower and upper corner of the workspace: x, y, z in m, tilt in rad; shape (4,) each."""
        lower, upper = np.append(self.position_lower_m, self.tilt_lower_rad), self.position_upper_m
        return lower, np.append(upper, self.tilt_upper_rad)

    def grid(self, *shares: ArrayLike) -> NDArray[np.float64]:
        """Return poses at all combinations of shares (0 to 1) of the box along x, y, z and tilt, shape (n, 4)."""
        lower, upper = self.box
        places = np.stack(np.meshgrid(*shares, indexing="ij"), axis=-1).reshape(-1, 4)
        return np.asarray(lower + (upper - lower) * places)


def shipped_layouts_file() -> Path:
    """Return the dimensions file that comes with the package.

    Raises:
        DescriptionError: the robot description is missing from the installation.
    """
    return description_folder() / "config" / "layouts.yaml"


def layout_names(layouts_file: Path | None = None) -> tuple[str, ...]:
    """Return the names of the layouts in a dimensions file (default: the shipped one), in the file's order.

    Raises:
        DescriptionError: the file is missing or wrong; names file, line and key.
    """
    path = layouts_file or shipped_layouts_file()
    return tuple(_parse(path, read_text(path)).layouts)


def load_layout(name: str = "paper", layouts_file: Path | None = None) -> Layout:
    """Return one layout of a dimensions file (default: the shipped one) in SI units.

    Raises:
        DescriptionError: the file is missing or wrong; names file, line and key.
        UnknownLayoutError: the file holds no such layout.
    """
    path = layouts_file or shipped_layouts_file()
    entry = check_layout(name, path, read_text(path))
    box = (entry.workspace.x.metres, entry.workspace.y.metres, entry.workspace.z.metres)
    tilt = entry.workspace.tilt.radians
    return Layout(
        name=name,
        path=path,
        position_lower_m=read_only(np.array([low for low, _ in box])),
        position_upper_m=read_only(np.array([high for _, high in box])),
        tilt_lower_rad=tilt[0],
        tilt_upper_rad=tilt[1],
        accuracy_m=entry.workspace.accuracy.metres,
        fixed_centres_m=entry.fixed_centres.metres,
        moving_centres_m=entry.moving_centres.metres,
        truss_span_m=entry.truss.span.metres,
        ladle=_ladle(entry.ladle),
    )


def check_layout(name: str, path: Path, text: str) -> LayoutEntry:
    """Return the checked entry of a layout from the text of a dimensions file.

    Raises:
        DescriptionError: the text is not a sound dimensions file.
        UnknownLayoutError: it holds no such layout.
    """
    layouts = _parse(path, text).layouts
    if name not in layouts:
        raise UnknownLayoutError(name, tuple(layouts), path)
    return layouts[name]


@lru_cache(maxsize=16)
def _parse(path: Path, text: str) -> LayoutsFile:
    """Return the checked file; its text is part of the key, so a file that was changed is read again."""

    def read() -> str:
        content = read_yaml(path)
        try:
            _refuse_ambiguous(path, content, yaml.load(text, _XACRO_LOADER))
        except yaml.YAMLError as error:
            raise DescriptionError(path, f"not valid YAML for xacro: {error}") from error
        return validate(LayoutsFile, content, path).model_dump_json()

    # Reading YAML takes thirty times as long as reading JSON.
    key = content_key([text, read_text(Path(layout_schema.__file__))])
    return LayoutsFile.model_validate_json(kept_text(f"layouts/{key}.json", read))


def _refuse_ambiguous(path: Path, ours: object, theirs: object, key: str = "") -> None:
    """Refuse a value that our reader (YAML 1.2) and xacro's (YAML 1.1) would take for different things.

    `7.85e3` is a number to one and text to the other, `010` is ten to one and eight to the other.
    """
    if isinstance(ours, dict) and isinstance(theirs, dict):
        for name, value in ours.items():
            if name not in theirs:
                seen = f"YAML readers disagree on the name '{name}'"
                raise DescriptionError(
                    path, f"'{key}': {seen}; put it in quotes" if key else f"{seen}; put it in quotes"
                )
            _refuse_ambiguous(path, value, theirs.get(name), f"{key}.{name}".lstrip("."))
    elif isinstance(ours, list) and isinstance(theirs, list) and len(ours) == len(theirs):
        for index, (mine, other) in enumerate(zip(ours, theirs, strict=True)):
            _refuse_ambiguous(path, mine, other, f"{key}.{index}")
    elif ours != theirs and not (isinstance(ours, float) and math.isnan(ours)):
        seen = f"YAML readers disagree on this value ({reprlib.repr(ours)} or {reprlib.repr(theirs)})"
        raise DescriptionError(path, f"'{key}': {seen}; write numbers as 12.5 or 1.0e+5")


def _ladle(entry: Ladle) -> LadleDimensions:
    return LadleDimensions(
        payload_kg=entry.payload.value,
        tare_kg=entry.tare.value,
        centre_of_mass_m=entry.centre_of_mass.metres,
        rim_centre_m=entry.rim_centre.metres,
        outer_radius_top_m=entry.outer_radius_top.metres,
        outer_radius_bottom_m=entry.outer_radius_bottom.metres,
        height_m=entry.height.metres,
        wall_m=entry.wall.metres,
        rim_flange_m=entry.rim_flange.metres,
        rim_flange_height_m=entry.rim_flange_height.metres,
        lip_reach_m=entry.lip_reach.metres,
        lip_half_angle_rad=entry.lip_half_angle.radians,
        melt_below_rim_m=entry.melt_below_rim.metres,
        mesh=entry.mesh.value,
    )
