"""``campaign.yaml``: what holds for a whole campaign. The file in its own units, and the same in SI units."""

import io
import math
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Self

import pydantic
from pydantic import Field, Strict
from ruamel.yaml import YAML

from pouring_robot.exceptions import CampaignError, CampaignFileError
from pouring_robot.io.temperatures import ABSOLUTE_ZERO_DEGC
from pouring_robot.io.typed_yaml import StrictModel, read_yaml, validate

_Number = Annotated[float, Strict()]
_Size = Annotated[_Number, Field(gt=0.0, lt=1e9)]
_Triple = tuple[_Number, _Number, _Number]
_Units = dict[str, dict[str, float]]
Triple = tuple[float, float, float]


Frames = Literal["one", "per session"]
PER_SESSION: Frames = "per session"


class CampaignMetadata(StrictModel):
    """What holds for a whole campaign, in SI units. None: not stated.

    Attributes:
        robot: name of the robot.
        description: a line for people.
        target: the body the target sits on; where on it is unknown and always fitted.
        frame: the frame the measurements are given in; where it stands is unknown and always fitted.
        frames: whether that is one place, or the tracker was set up anew in each session.
        sigma_position_m: standard deviation of a measured coordinate, in m.
        sigma_rotation_rad: standard deviation of a component of the measured rotation, in rad.
        sigma_distance_m: standard deviation of a measured distance, in m.
        sigma_closure_m: standard deviation of what redundant drives disagree by, in m.
        screw_pitch_m: travel of a leg a turn of its screw, in m.
        truss_span_m: length of the rails, in m.
        ladle_tare_kg: mass of the empty ladle, in kg.
        ladle_centre_of_mass_m: centre of mass of the ladle in the moving platform's frame, in m.
        reference_temperature_degC: temperature at which the drawing holds, in °C.
    """

    robot: str = "pouring_robot"
    description: str = ""
    target: str = "moving_platform"
    frame: str = "tracker"
    frames: Frames = "one"
    sigma_position_m: _Size | None = None
    sigma_rotation_rad: _Size | None = None
    sigma_distance_m: _Size | None = None
    sigma_closure_m: _Size | None = None
    screw_pitch_m: _Size | None = None
    truss_span_m: _Size | None = None
    ladle_tare_kg: _Size | None = None
    ladle_centre_of_mass_m: Triple | None = None
    reference_temperature_degC: float | None = None  # noqa: N815 - the unit is spelt as in the campaign files


class _Section(StrictModel):
    """A part of the file in which a fact may be given in one of several units.

    ``UNITS`` names each fact as :class:`CampaignMetadata` does, with the keys it may have and how many of that unit
    make one inside.
    """

    UNITS: ClassVar[_Units] = {}

    def facts(self) -> dict[str, Any]:
        """Return the facts in SI units; None: not stated."""
        found: dict[str, Any] = {}
        for fact, per_unit in self.UNITS.items():
            given = [name for name in per_unit if getattr(self, name) is not None]
            if len(given) > 1:
                raise ValueError(f"'{given[0]}' and '{given[1]}' say the same thing; keep one")
            found[fact] = None
            for name in given:
                value, divisor = getattr(self, name), per_unit[name]
                triple = isinstance(value, tuple)
                found[fact] = tuple(v / divisor for v in value) if triple else value / divisor
        return found

    @pydantic.model_validator(mode="after")
    def _unambiguous(self) -> Self:
        self.facts()
        return self


class _Metrology(_Section):
    target: str = "moving_platform"
    frame: str = "tracker"
    frames: Frames = "one"
    sigma_position_mm: _Size | None = None
    sigma_position_m: _Size | None = None
    sigma_rotation_rad: _Size | None = None
    sigma_rotation_mrad: _Size | None = None
    sigma_rotation_deg: _Size | None = None
    sigma_distance_mm: _Size | None = None
    sigma_distance_m: _Size | None = None
    sigma_closure_mm: _Size | None = None
    sigma_closure_m: _Size | None = None
    UNITS: ClassVar[_Units] = {
        "sigma_distance_m": {"sigma_distance_m": 1.0, "sigma_distance_mm": 1e3},
        "sigma_closure_m": {"sigma_closure_m": 1.0, "sigma_closure_mm": 1e3},
        "sigma_position_m": {"sigma_position_m": 1.0, "sigma_position_mm": 1e3},
        "sigma_rotation_rad": {
            "sigma_rotation_rad": 1.0,
            "sigma_rotation_mrad": 1e3,
            "sigma_rotation_deg": 180.0 / math.pi,
        },
    }


class _Drives(_Section):
    screw_pitch_mm: _Size | None = None
    screw_pitch_m: _Size | None = None
    UNITS: ClassVar[_Units] = {"screw_pitch_m": {"screw_pitch_m": 1.0, "screw_pitch_mm": 1e3}}


class _Truss(_Section):
    span_m: _Size | None = None
    span_mm: _Size | None = None
    UNITS: ClassVar[_Units] = {"truss_span_m": {"span_m": 1.0, "span_mm": 1e3}}


class _Ladle(_Section):
    tare_kg: _Size | None = None
    centre_of_mass_mm: _Triple | None = None
    centre_of_mass_m: _Triple | None = None
    UNITS: ClassVar[_Units] = {
        "ladle_tare_kg": {"tare_kg": 1.0},
        "ladle_centre_of_mass_m": {"centre_of_mass_m": 1.0, "centre_of_mass_mm": 1e3},
    }


class _CampaignFile(_Section):
    """The file as it is written."""

    robot: str = "pouring_robot"
    description: str = ""
    metrology: _Metrology = _Metrology()
    drives: _Drives = _Drives()
    truss: _Truss = _Truss()
    ladle: _Ladle = _Ladle()
    reference_temperature_degC: Annotated[_Number, Field(ge=ABSOLUTE_ZERO_DEGC, lt=1e4)] | None = None  # noqa: N815
    reference_temperature_K: Annotated[_Number, Field(ge=0.0, lt=1e4)] | None = None  # noqa: N815
    UNITS: ClassVar[_Units] = {
        "reference_temperature_degC": {"reference_temperature_degC": 1.0, "reference_temperature_K": 1.0}
    }

    def to_si(self) -> CampaignMetadata:
        facts = self.facts()
        for section in (self.metrology, self.drives, self.truss, self.ladle):
            facts |= section.facts()
        if self.reference_temperature_K is not None:
            facts["reference_temperature_degC"] = self.reference_temperature_K + ABSOLUTE_ZERO_DEGC
        facts |= {"target": self.metrology.target, "frame": self.metrology.frame, "frames": self.metrology.frames}
        return CampaignMetadata(robot=self.robot, description=self.description, **facts)


def metadata_path(path: Path | str) -> Path:
    """Return the YAML file that belongs to a campaign's table: the same stem, ``.yaml`` or ``.yml``.

    Raises:
        CampaignError: there is none.
    """
    table = Path(path)
    try:
        for suffix in (".yaml", ".yml"):
            candidate = table.with_suffix(suffix)
            if candidate.is_file():
                return candidate
    except (OSError, ValueError) as error:
        raise CampaignError(table, f"is no usable file name: {error}") from error
    beside = table.with_suffix(".yaml").name
    raise CampaignError(
        table,
        f"the file {beside} with metrology noise and robot data is missing beside it; write one, "
        "as 'campaign simulate' does",
    )


def read_metadata(path: Path | str) -> CampaignMetadata:
    """Read the YAML file of a campaign.

    Raises:
        CampaignFileError: the file cannot be read, or a key or value in it is wrong; names line and key.
    """
    path = Path(path)
    return validate(_CampaignFile, read_yaml(path, CampaignFileError), path, CampaignFileError).to_si()


def metadata_text(metadata: CampaignMetadata) -> str:
    """Return metadata as the text of a campaign's YAML file, in the units people use; what is None is left out."""

    def times(value: float | None, factor: float) -> float | None:
        return None if value is None else float(f"{value * factor:.12g}")

    centre = metadata.ladle_centre_of_mass_m
    content: dict[str, Any] = {
        "robot": metadata.robot,
        "description": metadata.description,
        "metrology": {
            "target": metadata.target,
            "frame": metadata.frame,
            "frames": None if metadata.frames == "one" else metadata.frames,
            "sigma_position_mm": times(metadata.sigma_position_m, 1e3),
            "sigma_rotation_rad": times(metadata.sigma_rotation_rad, 1.0),
            "sigma_distance_mm": times(metadata.sigma_distance_m, 1e3),
            "sigma_closure_mm": times(metadata.sigma_closure_m, 1e3),
        },
        "drives": {"screw_pitch_mm": times(metadata.screw_pitch_m, 1e3)},
        "truss": {"span_m": times(metadata.truss_span_m, 1.0)},
        "ladle": {
            "tare_kg": times(metadata.ladle_tare_kg, 1.0),
            "centre_of_mass_mm": None if centre is None else [times(value, 1e3) for value in centre],
        },
        "reference_temperature_degC": metadata.reference_temperature_degC,
    }
    stream = io.StringIO()
    yaml = YAML()
    yaml.width = 110
    yaml.dump(_without_none(content), stream)
    return stream.getvalue()


def _without_none(content: dict[str, Any]) -> dict[str, Any]:
    kept = {key: _without_none(value) if isinstance(value, dict) else value for key, value in content.items()}
    return {key: value for key, value in kept.items() if value is not None and value != {}}
