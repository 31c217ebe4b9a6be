"""``campaign.yaml``: facts about a whole campaign, in the file's units and in SI units; writing both of its files."""

import io
from collections.abc import Collection, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Self

import numpy as np
import pydantic
from pydantic import Field

from pouring_robot.campaign.columns import MEASURED
from pouring_robot.exceptions import CampaignError, OutputError
from pouring_robot.io.files import CSV_SUFFIXES, PARQUET_SUFFIXES, check_ending
from pouring_robot.io.quantity_columns import LIMITS, Quantity
from pouring_robot.io.tables import csv_text
from pouring_robot.io.temperatures import SURROUNDINGS_DEGC, ZERO_CELSIUS_K
from pouring_robot.io.typed_yaml import Size, StrictModel, read_yaml, validate, yaml_text
from pouring_robot.io.units import OF_UNIT, to_inner
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.robot.heat_section import Surroundings

_Tare = Annotated[float, Field(gt=0.0, le=LIMITS["mass"][1])]
LEAST_SIGMA = 1e-8
"""In m or rad, the least noise that may be stated: files hold hardly more digits, and residuals at such a noise are
rounding."""
Triple = tuple[float, float, float]
Frames = Literal["one", "per session"]
PER_SESSION: Frames = "per session"
Approach = Literal["stated", "row before"]
FROM_THE_ROW_BEFORE: Approach = "row before"
# Digits written: a hundredth of the best tracker's noise.
_DIGITS = {"length": 6, "angle": 10, "force": 4, "moment": 4, "mass": 3, "temperature": 3, "time": 3, "sign": 0}


class CampaignMetadata(StrictModel):
    """Facts about a whole campaign, in SI units. None: not stated."""

    robot: str | None = None  # the name in its robot file
    description: str = ""
    target: str = "moving_platform"  # the body that carries the target; the place on it is unknown and always fitted
    frame: str = "tracker"  # in which measurements are given; its place is unknown and always fitted
    frames: Frames = "one"  # whether the tracker has one place, or was set up anew in each session
    sigma_position_m: Size | None = None  # standard deviation of a measured coordinate
    sigma_rotation_rad: Size | None = None  # of a component of the measured rotation
    sigma_distance_m: Size | None = None  # of a distance
    sigma_closure_m: Size | None = None  # of the disagreement of redundant drives
    screw_pitch_m: Size | None = None  # travel of a sliding drive per turn of its screw
    # source of the side each drive came from: the table alone, or also the row before, where poses follow directly
    approach: Approach = "stated"
    truss_span_m: Size | None = None  # length of the rails
    ladle_tare_kg: _Tare | None = None  # mass of the empty ladle
    ladle_centre_of_mass_m: Triple | None = None  # in the moving platform's frame
    reference_temperature_degC: Surroundings | None = None  # at which the drawing holds

    @property
    def stated(self) -> dict[str, Any]:
        """Facts by section and key of the file, such as ``truss.span_m``; None: not stated."""
        both = ((name, *fact) for name, facts in _KEYS.items() for fact in facts.items())
        return {f"{name}.{keys[0]}": getattr(self, fact) for name, fact, keys in both}

    @property
    def own_frames(self) -> bool:
        """Whether each session was measured from a place of its own."""
        return self.frames == PER_SESSION

    @property
    def metres_per_rad(self) -> float:
        """Noise of a coordinate over noise of a rotation component, in m; 1 m where they are not both stated."""
        position, rotation = self.sigma_position_m, self.sigma_rotation_rad
        return position / rotation if position and rotation else 1.0


_KEYS: dict[str, dict[str, tuple[str, ...]]] = {
    "metrology": {
        "sigma_position_m": ("sigma_position_mm", "sigma_position_m"),
        "sigma_rotation_rad": ("sigma_rotation_rad", "sigma_rotation_mrad", "sigma_rotation_deg"),
        "sigma_distance_m": ("sigma_distance_mm", "sigma_distance_m"),
        "sigma_closure_m": ("sigma_closure_mm", "sigma_closure_m"),
    },
    "drives": {"screw_pitch_m": ("screw_pitch_mm", "screw_pitch_m")},
    "truss": {"truss_span_m": ("span_m", "span_mm")},
    "ladle": {
        "ladle_tare_kg": ("tare_kg",),
        "ladle_centre_of_mass_m": ("centre_of_mass_mm", "centre_of_mass_m"),
    },
}
"""The facts of each section of the file, named as in :class:`CampaignMetadata`, with the keys that each may have, first
the one that is written; a key ends in its unit."""


class _Section(StrictModel):
    """A part of the file in which a fact may be given in one of several units."""

    keys: ClassVar[dict[str, tuple[str, ...]]] = {}

    def facts(self) -> dict[str, Any]:
        """Return the facts in SI units; None: not stated."""
        found: dict[str, Any] = {}
        for fact, keys in self.keys.items():
            given = [name for name in keys if getattr(self, name) is not None]
            if len(given) > 1:
                raise ValueError(f"'{given[0]}' and '{given[1]}' say the same thing; keep one")
            found[fact] = to_inner(np.array(getattr(self, given[0])), _unit(given[0])).tolist() if given else None
        return found

    @pydantic.model_validator(mode="after")
    def _unambiguous(self) -> Self:
        self.facts()
        return self


def _section(name: str, **more: Any) -> tuple[Any, _Section]:
    """Return a section of the file as a field: its type, and its value where it is left out."""
    typed: dict[str, Any] = {key: (_kind(fact, key) | None, None) for fact, keys in _KEYS[name].items() for key in keys}
    kind = pydantic.create_model(f"_{name}", __base__=_Section, **typed, **more)
    kind.keys = _KEYS[name]
    return kind, kind()


def _unit(key: str) -> str:
    return key.rpartition("_")[2]


def _kind(fact: str, key: str) -> Any:
    """Return the type of a fact in the unit of its key."""
    if fact.startswith("sigma_"):
        return Annotated[float, Field(ge=float(f"{LEAST_SIGMA * OF_UNIT[_unit(key)][0]:.3g}"), lt=1e9)]
    return {"ladle_centre_of_mass_m": Triple, "ladle_tare_kg": _Tare}.get(fact, Size)


_TEMPERATURE = "reference_temperature_degC"
_COLDEST_K, _HOTTEST_K = (round(limit + ZERO_CELSIUS_K, 2) for limit in SURROUNDINGS_DEGC)
_FIELDS: dict[str, Any] = {
    "robot": (str | None, None),
    "description": (str, ""),
    "metrology": _section("metrology", target=(str, "moving_platform"), frame=(str, "tracker"), frames=(Frames, "one")),
    "drives": _section("drives", approach=(Approach, "stated")),
    **{name: _section(name) for name in ("truss", "ladle")},
    _TEMPERATURE: (Surroundings | None, None),
    "reference_temperature_K": (Annotated[float, Field(ge=_COLDEST_K, le=_HOTTEST_K)] | None, None),
}
_FILE: Any = pydantic.create_model("_FILE", __base__=_Section, **_FIELDS)
_FILE.keys = {_TEMPERATURE: (_TEMPERATURE, "reference_temperature_K")}


def metadata_path(path: Path | str) -> Path:
    """Return the YAML of a campaign's table: its stem and ``.yaml`` or ``.yml``; raises CampaignError without one."""
    table = Path(path)
    try:
        for suffix in (".yaml", ".yml"):
            candidate = table.with_suffix(suffix)
            if candidate.is_file():
                return candidate
    except (OSError, ValueError) as error:
        raise CampaignError(table, f"is no usable file name: {error}") from error
    raise CampaignError(
        table,
        f"the file {table.with_suffix('.yaml').name} with measurement noise and robot data is missing beside it; write "
        "one, like 'campaign simulate' does, with at least a line 'robot: NAME'",
    )


def read_metadata(path: Path | str) -> CampaignMetadata:
    """Read the YAML file of a campaign; raises DescriptionError, with line and key, if it or a value is wrong."""
    return metadata_in(read_yaml(path), path)


def metadata_in(content: Mapping[str, Any], path: Path | str) -> CampaignMetadata:
    """Return the metadata in such a file's content, of or for ``path``; raises as :func:`read_metadata`."""
    file = validate(_FILE, content, path)
    facts = file.facts()
    for name in _KEYS:
        facts |= getattr(file, name).facts()
    setting = {key: getattr(file.metrology, key) for key in ("target", "frame", "frames")}
    setting["approach"] = file.drives.approach
    return CampaignMetadata(robot=file.robot, description=file.description, **setting, **facts)


def metadata_text(metadata: CampaignMetadata) -> str:
    """Return metadata as the text of a campaign's YAML file, in usual units; facts that are None are left out."""
    content: dict[str, Any] = {"robot": metadata.robot} if metadata.robot else {}
    content["description"] = metadata.description
    content["metrology"] = {"target": metadata.target, "frame": metadata.frame}
    if metadata.frames != "one":
        content["metrology"]["frames"] = metadata.frames
    for name, facts in _KEYS.items():
        for fact, (key, *_) in facts.items():
            if (value := getattr(metadata, fact)) is not None:
                shown = [float(f"{one * OF_UNIT[_unit(key)][0]:.12g}") for one in np.ravel(value).tolist()]
                content.setdefault(name, {})[key] = shown if isinstance(value, tuple) else shown[0]
    if metadata.approach != "stated":
        content.setdefault("drives", {})["approach"] = metadata.approach
    if metadata.reference_temperature_degC is not None:
        content[_TEMPERATURE] = metadata.reference_temperature_degC
    return yaml_text(content, width=110)


def check_table_name(path: Path) -> None:
    """Refuse a name of a campaign's table by its suffix, before any work; raises OutputError."""
    if path.suffix.lower() in (".yaml", ".yml"):
        raise OutputError(path, "give the name of the table, such as campaign.csv; the YAML is written beside it")
    check_ending(path, (*CSV_SUFFIXES, *PARQUET_SUFFIXES))


def campaign_files(
    path: Path, columns: Iterable[tuple[Quantity, FloatArray | Sequence[str]]], metadata: CampaignMetadata
) -> dict[Path, bytes]:
    """Return the contents of a campaign's two files, by path: the table, CSV or Parquet by its suffix, and the YAML.

    Columns hold their n values in internal units; labels that are all empty are left out. Raises OutputError as
    :func:`check_table_name`.
    """
    check_table_name(path)
    cells, labels = dict[str, list[str]](), set[str]()
    for column, values in columns:
        if column.kind == "label":
            cells |= {column.name: [str(value) for value in values]} if any(values) else {}
            labels.add(column.name)
            continue
        millimetres = column.kind == "length" and (column.required or column.name in MEASURED)
        digits = _DIGITS[column.kind]
        scaled = np.round(np.asarray(values, dtype=float) * (1e3 if millimetres else 1.0), digits) + 0.0
        heading = f"{column.name}_mm" if millimetres else column.canonical
        cells[heading] = ["" if np.isnan(value) else f"{value:.{digits}f}" for value in scaled]
    parquet = path.suffix.lower() in PARQUET_SUFFIXES
    table = _parquet(cells, labels) if parquet else csv_text(cells, zip(*cells.values(), strict=True)).encode()
    return {path: table, path.with_suffix(".yaml"): metadata_text(metadata).encode()}


def _parquet(cells: Mapping[str, list[str]], labels: Collection[str]) -> bytes:
    import pyarrow
    import pyarrow.parquet

    content = {
        heading: column if heading in labels else [float(cell) if cell else None for cell in column]
        for heading, column in cells.items()
    }
    stream = io.BytesIO()
    pyarrow.parquet.write_table(pyarrow.table(content), stream)
    return stream.getvalue()
