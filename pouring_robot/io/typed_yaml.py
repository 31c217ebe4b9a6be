"""Reading YAML files into typed, validated objects, with errors that name file, line and key; and writing them.

Every YAML file of the package (loops, layouts, models, sweeps, campaigns) is read through :func:`read_yaml`
and :func:`validate`, so that a misspelt key is reported in the same way everywhere.
"""

import difflib
import functools
import io
import numbers
import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Generic, Literal, TypeVar, get_args

import pydantic
from pydantic.fields import FieldInfo
from pydantic_core import CoreSchema, PydanticKnownError
from pydantic_core.core_schema import no_info_before_validator_function
from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedMap, CommentedSeq
from ruamel.yaml.error import MarkedYAMLError, YAMLError
from ruamel.yaml.scalarbool import ScalarBoolean

from pouring_robot.exceptions import BadInputError, DescriptionError
from pouring_robot.io.files import read_text
from pouring_robot.io.units import LARGEST, UNITS


def _upwards(limits: tuple[float, float]) -> tuple[float, float]:
    if limits[0] > limits[1]:
        raise ValueError(f"a range starts with its lower end, unlike {limits[0]:g} to {limits[1]:g}")
    return limits


Size = Annotated[float, pydantic.Field(gt=0.0, lt=LARGEST)]
Range = Annotated[tuple[float, float], pydantic.AfterValidator(_upwards)]
FileModel = TypeVar("FileModel", bound=pydantic.BaseModel)
Value = TypeVar("Value")
Unit = TypeVar("Unit")
_UNITS = {unit.lower() for units in UNITS.values() for unit in units}
_IN_YAML = {  # pydantic uses Python's names of types
    "tuple_type": "Input should be a list",
    "list_type": "Input should be a list",
    "dict_type": "Input should be a mapping of keys to values",
    "model_type": "Input should be a mapping of keys to values",
    "string_type": "Input should be text; put it in quotes",
}
_REFUSED_AS: dict[str, Literal["float_type", "int_type"]] = {"float": "float_type", "int": "int_type"}


def _numbers_only(schema: Any, model: Any) -> Any:
    """Return a part of a model's schema in which the text "350" and the switch `true` are not accepted as numbers."""
    if isinstance(schema, list):
        return [_numbers_only(part, model) for part in schema]
    if not isinstance(schema, dict):
        return schema
    if schema.get("type") == "model" and schema["cls"] is not model and issubclass(schema["cls"], StrictModel):
        return schema  # it has done so for its own numbers
    whole = {key: _numbers_only(part, model) for key, part in schema.items()}
    if schema.get("type") not in ("float", "int"):  # "type" may also be the name of a field
        return whole
    # Pydantic's own strict mode would also refuse 1e4 for a whole number.
    return no_info_before_validator_function(functools.partial(_a_number, _REFUSED_AS[schema["type"]]), whole)


def _a_number(refused_as: Literal["float_type", "int_type"], value: Any) -> Any:
    if isinstance(value, bool | ScalarBoolean) or not isinstance(value, numbers.Real):
        raise PydanticKnownError(refused_as)
    return value


class StrictModel(pydantic.BaseModel):
    """Base of all file models: immutable, no unknown keys, numbers are numbers, no NaN or infinity.

    A mistake raises BadInputError where the model is made in Python; :func:`validate` raises the error of a file.
    """

    model_config = pydantic.ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    def __init__(self, /, **values: Any) -> None:
        try:
            super().__init__(**values)
        except pydantic.ValidationError as problem:
            raise BadInputError(f"{type(self).__name__}: {_said(type(self), values, problem)[0]}") from problem

    # Otherwise pydantic would call it for each model inside a file's model, whose errors have places in the file.
    __init__.__pydantic_base_init__ = True  # type: ignore[attr-defined]

    @classmethod
    def __get_pydantic_core_schema__(cls, source: Any, handler: pydantic.GetCoreSchemaHandler) -> CoreSchema:
        """Return pydantic's schema of the model, in which only numbers are accepted as numbers."""
        schema: CoreSchema = _numbers_only(handler(source), source)
        return schema


class Entry(StrictModel, Generic[Value, Unit]):
    """One fact with its unit and its source."""

    value: Value
    unit: Unit
    source: Literal["paper", "inferred", "assumed"]
    note: str = ""


class Entries(StrictModel):
    """A model of entries. It is pickled by its content: pickle finds no name for the classes of single entries."""

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self).model_validate, (self.model_dump(exclude_unset=True),)


def read_yaml(path: Path | str, wanted: str = "a YAML file with one") -> CommentedMap:
    """Read a YAML file whose top level is a mapping; do not change its parts, which a second read may return again.

    ``wanted`` says which file to give instead where the top level is no mapping.

    Raises:
        DescriptionError: the file is missing, unreadable, not YAML, has a key twice, or is not a mapping; the message
            names the line.
    """
    return parse_yaml(read_text(Path(path)), Path(path), wanted)


def parse_yaml(text: str, path: Path, wanted: str = "a YAML file with one") -> CommentedMap:
    """Parse the text of such a file, at ``path`` or meant for it; raises as :func:`read_yaml`."""
    if text.lstrip().startswith("<") and "<robot" in text:
        command = f"pouring-robot robot init {shlex.quote(str(path))}"
        raise DescriptionError(path, f"is a URDF, not YAML; '{command}' makes a robot file of it")
    try:
        content = _parsed(text)
    except MarkedYAMLError as problem:
        line = f"line {problem.problem_mark.line + 1}: " if problem.problem_mark else ""
        # For a duplicate key the reader quotes all that is under it.
        summary = str(problem.problem or problem.context).splitlines()[0].partition(" with value")[0][:200]
        raise DescriptionError(path, f"{line}not valid YAML: {summary}") from problem
    except (YAMLError, ValueError) as problem:  # such as a number or a character YAML cannot hold
        raise DescriptionError(path, f"not valid YAML: {str(problem).splitlines()[0]}") from problem
    except NotImplementedError as problem:  # the reader attaches comments to the item before them
        raise DescriptionError(path, "not valid YAML: a comment stands where the reader cannot place it") from problem
    except (TypeError, AttributeError) as problem:  # the reader cannot hold a mapping with a list in it as a key
        said = "not valid YAML: a key is a list or a mapping, or << merges something that is not a mapping"
        raise DescriptionError(path, said) from problem
    except RecursionError as problem:
        raise DescriptionError(path, "not valid YAML: brackets or blocks are nested too deep") from problem
    if not isinstance(content, CommentedMap):
        raise DescriptionError(path, f"must be a mapping of keys to values at its top level; give {wanted}")
    own: CommentedMap = content.copy()  # with its line numbers; the cached content stays as parsed
    return own


def yaml_text(content: Any, **style: Any) -> str:
    """Return content as YAML; ``style`` are attributes of ruamel's ``YAML``, such as ``width``."""
    yaml, stream = YAML(), io.StringIO()
    vars(yaml).update(style)
    yaml.dump(content, stream)
    return stream.getvalue()


@functools.lru_cache(maxsize=16)
def _parsed(text: str) -> Any:
    """Return the content of a text, cached: parsing the loops file, which every robot needs, takes 0.02 s."""
    return YAML(typ="rt").load(text)


def _in_the_file(content: Any, location: Sequence[str | int], missing: bool) -> tuple[list[str | int], int | None]:
    """Return pydantic's location of an error as a place in the file, without the types that pydantic tried.

    Also return the 1-based line of its deepest part that has one. ``missing``: its last part is a key that is not in
    the file.
    """
    found, line = list[str | int](), None
    parts: Any = location[: len(location) - missing]
    for key in parts:
        if key in content if isinstance(content, Mapping) else isinstance(key, int):
            found.append(key)
            if isinstance(content, CommentedSeq):
                line = int(content.lc.item(key)[0]) + 1
            elif isinstance(content, CommentedMap) and key in (content.lc.data or {}):  # keys merged in by << are not
                line = int(content.lc.key(key)[0]) + 1
            content = content[key] if isinstance(content, Mapping | list) else None
    return [*found, *location[len(location) - missing :]], line


def _known_fields(model: type[pydantic.BaseModel], location: Sequence[str | int]) -> dict[str, FieldInfo]:
    """Return the fields allowed at a place of the file, by key, as far as the types determine them."""
    current: Any = model
    for key in location:
        fields = getattr(current, "model_fields", {})
        annotation = fields[key].annotation if key in fields else None
        nested = [a for a in (annotation, *getattr(annotation, "__args__", ())) if hasattr(a, "model_fields")]
        current = nested[0] if nested else (current if annotation is None else None)
        if current is None:
            return {}
    return {field.alias or name: field for name, field in current.model_fields.items()}


def _instead(key: str, known: Mapping[str, FieldInfo]) -> str:
    """Return what to write instead of a key: the same with a valid unit, or the nearest key."""
    stem, _, unit = key.rpartition("_")
    for same, wrong in ((key, "it has no unit"), (stem, f"'{unit}' is not one of its units")):
        in_units = [name for name in known if name.startswith(f"{same}_") and name[len(same) + 1 :].lower() in _UNITS]
        if same and in_units:
            return f": {wrong}; write {' or '.join(in_units)}"
    for near in difflib.get_close_matches(key, known, n=1):
        unit_of_key = known[near].description
        return f"; did you mean '{near}'{f' (in {unit_of_key})' if unit_of_key else ''}?"
    return ""


def _unit_of(model: type[pydantic.BaseModel], content: Any, location: Sequence[str | int]) -> str:
    """Return the unit given next to a value under ``unit``, or in the description of its key; "" without."""
    unit = ""
    for k, key in enumerate(location):
        field = _known_fields(model, location[:k]).get(str(key))
        unit = (field.description if field else None) or unit
        if isinstance(content, Mapping) and isinstance(content.get("unit"), str) and key != "unit":
            unit = content["unit"]
        content = content[key] if k + 1 < len(location) else None
    return unit


def _said(model: type[pydantic.BaseModel], content: Any, problem: pydantic.ValidationError) -> tuple[str, int | None]:
    """Return the first mistake in words, and its line, where the content has one."""
    # A file of another kind says so in its format; a misspelt key is also a missing one. These are to be fixed first.
    errors = sorted(
        problem.errors(include_url=False),
        key=lambda one: (one["loc"] != ("format",) or one["type"] == "missing", one["type"] != "extra_forbidden"),
    )
    first, *others = errors
    location, line = _in_the_file(content, first["loc"], first["type"] == "missing")
    where = ".".join(str(part) for part in location)
    strange = False  # whether it may be a file of another kind without saying so
    if first["type"] == "extra_forbidden":
        instead = _instead(str(location[-1]), _known_fields(model, location[:-1]))
        message = f"unknown key '{where}'{instead}"
        strange = not instead and len(location) == 1 and "format" in model.model_fields
    elif first["type"] == "missing":
        message = f"key '{where}' is missing"
    else:
        unit = f", in {shown}" if (shown := _unit_of(model, content, location)) else ""
        given = "" if isinstance(first["input"], dict | list) else f" (it is {first['input']!r})"
        said = _IN_YAML.get(first["type"]) or first["msg"].removeprefix("Value error, ")
        if first["type"] == "model_type":
            keys = [key for key, field in _known_fields(model, location).items() if field.is_required()]
            said += f", with {' and '.join(keys)}" if keys else ""
        message = f"'{where}': {said}{unit}{given}" if where else said
    message += f" (and {len(others)} more)" if others else ""
    if strange or any(one["loc"] == ("format",) for one in others):
        message += f"; the file must be of format: {get_args(model.model_fields['format'].annotation)[0]}"
    return message, line


def validate(model: type[FileModel], content: Mapping[str, Any], path: Path | str) -> FileModel:
    """Turn the content of a YAML file into ``model``.

    Raises:
        DescriptionError: names the first mistake with its line and key and, for an unknown key, the nearest known one.
    """
    try:
        return model.model_validate(content)
    except pydantic.ValidationError as problem:
        message, line = _said(model, content, problem)
        raise DescriptionError(path, (f"line {line}: " if line else "") + message) from problem
