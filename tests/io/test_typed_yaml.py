"""Errors in YAML files name the file, the line and the key."""

from typing import Literal

import pydantic
import pytest

from pouring_robot.exceptions import BadInputError, DescriptionError
from pouring_robot.io.typed_yaml import StrictModel, read_yaml, validate


class Size(StrictModel):
    """A value whose unit stands beside it."""

    value: float = pydantic.Field(gt=0)
    unit: Literal["mm", "m"]


class Part(StrictModel):
    """A part."""

    mass_kg: float = pydantic.Field(gt=0)
    name: str = ""
    teeth: int = 0
    place_mm: tuple[float, float] | None = None
    turn: float = pydantic.Field(default=0.0, description="rad")
    size: Size | None = None


class Machine(StrictModel):
    """A machine."""

    format: Literal["machine/1"] = "machine/1"
    parts: tuple[Part, ...] = ()
    named: dict[str, Part] = pydantic.Field(default_factory=dict)
    base: Part | None = None
    drive: tuple[Part, ...] | str = ""


WRITTEN = "machine.yaml"


def read(path):
    return validate(Machine, read_yaml(path), path)


def test_reads_what_is_right(written):
    machine = read(written("parts:\n- {mass_kg: 2}\nnamed: {a: {mass_kg: 3.5, name: lever}}\n"))
    assert machine.parts[0].mass_kg == 2.0
    assert machine.named["a"].name == "lever"
    part = read(written("base: {mass_kg: 1e3, teeth: 1.2e+1, place_mm: [0, -1]}\n")).base
    assert part == Part(mass_kg=1000.0, teeth=12, place_mm=(0.0, -1.0))


@pytest.mark.parametrize(
    ("content", "line", "words"),
    [
        ("parts:\n- mass_kg: 2\n- mas_kg: 3\n", 3, "mas"),
        ("parts:\n- mass_kg: 2\n  nam: x\n", 3, "unknown key 'parts.0.nam'; did you mean 'name'"),
        ("base:\n  nmae: x\n  mass_kg: 1\n", 2, "did you mean 'name'"),
        ("named:\n  a:\n    mass_kg: 1\n    nime: x\n", 4, "did you mean 'name'"),
        ("named:\n  a: {mass_kg: -1}\n", 2, "named.a.mass_kg"),
        ("named:\n  a: {mass_kg: .nan}\n", 2, "finite"),
        ("named:\n  a: {mass_kg: heavy}\n", 2, "it is 'heavy'"),
        ("named:\n  a: {mass_kg: '3'}\n", 2, r"'named.a.mass_kg': .* valid number \(it is '3'\)"),
        ("named:\n  a:\n    mass_kg: true\n", 3, r"valid number \(it is True\)"),
        ("parts:\n- mass_kg: 1\n  place_mm: [1, true]\n", 3, "'parts.0.place_mm.1': .* valid number"),
        ("base:\n  mass_kg: 1\n  place_mm: [1, &on true]\n", 3, "'base.place_mm.1': .* valid number"),
        ("base: {mass_kg: 1, teeth: '12'}\n", 1, r"valid integer \(it is '12'\)"),
        ("base: {mass_kg: 1, teeth: false}\n", 1, r"valid integer \(it is False\)"),
        ("base: {mass_kg: 1, teeth: 12.5}\n", 1, "integer"),
        ("base: {mass: 1}\n", 1, r"'base.mass': it has no unit; write mass_kg \(and"),
        ("base: {mass_kg: 1, place_in: [1, 1]}\n", 1, "'base.place_in': 'in' is not one of its units; write place_mm$"),
        ("base: {mass_kg: 1, trun: 9}\n", 1, r"'base.trun'; did you mean 'turn' \(in rad\)"),
        ("base: {mass_kg: 1, turn: 90 deg}\n", 1, r"'base.turn': .* valid number, in rad \(it is '90 deg'\)"),
        ("base: {mass_kg: 1, size: {value: -3, unit: mm}}\n", 1, r"'base.size.value': .*, in mm \(it is -3\)"),
        ("base: {mass_kg: 1, size: {value: 3, unit: s}}\n", 1, r"'base.size.unit': .*'mm' or 'm' \(it is 's'\)"),
        ("party:\n- 1\n", 1, "unknown key 'party'; did you mean 'parts'"),
        ("parts: 5\n", 1, "it is 5"),
        ("party: 1\nformat: ship/1\n", 2, r"'machine/1' \(it is 'ship/1'\) \(and 1 more\)"),
        ("drive:\n- {mass_kg: 1}\n- {mass_kg: -1}\n", 3, "'drive.1.mass_kg': .* greater than 0"),
        ("drive:\n- {name: x}\n", 2, "key 'drive.0.mass_kg' is missing"),
        ("drive: 5\n", 1, r"'drive': .* a list \(it is 5\)"),
        ("parts:\n- motor\n", 2, r"'parts.0': .* a mapping of keys to values, with mass_kg \(it is 'motor'\)"),
        ("named: [a]\n", 1, "'named': .* a mapping of keys to values$"),
        ("base: {mass_kg: 1, name: 7}\n", 1, r"'base.name': .* text; put it in quotes \(it is 7\)"),
        ("parts:\n- {name: x}\n", 2, "key 'parts.0.mass_kg' is missing"),
    ],
)
def test_names_line_and_key(written, content, line, words):
    path = written(content)
    with pytest.raises(DescriptionError, match=words) as caught:
        read(path)
    assert str(caught.value).startswith(f"{path}: line {line}: ")
    assert "\n" not in str(caught.value)
    assert caught.value.path == path


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("parts: [1, 2\n", "not valid YAML"),
        ("parts: []\nparts: []\n", "line 2: not valid YAML.*duplicate"),
        ("a: b: c\n", "line 1: not valid YAML"),
        ("- 1\n- 2\n", "mapping"),
        ("", "mapping"),
        ("just words", "mapping"),
        (b"\xff\xfe\x00parts", "UTF-8"),
        (b"parts: \x00\n", "not valid YAML"),
        ("parts: &a [*a]\n", "parts"),
        ("parts: *missing\n", "not valid YAML"),
        ("parts:       # all\n   p]\n\nx:    # y\n  a: 1\n", "not valid YAML: a comment stands where"),
        ("? [1, 2]\n: 3\n", "."),
        ("parts: 2001-99-99\n", "."),
    ],
)
def test_broken_files(written, content, words):
    with pytest.raises(DescriptionError, match=words) as caught:
        read(written(content))
    assert "\n" not in str(caught.value)


def test_keys_that_a_reader_adds_are_not_in_the_file_for_the_next(written):
    path = written("name: one\n")
    content = read_yaml(path)
    content |= {"name": "two", "more": 1}
    assert read_yaml(path) == {"name": "one"}


def test_missing_file_and_the_kind_of_error(tmp_path):
    with pytest.raises(DescriptionError, match=r"absent\.yaml: cannot be read: No such file"):
        read_yaml(tmp_path / "absent.yaml")
    with pytest.raises(DescriptionError, match="cannot be read"):
        read_yaml(tmp_path)


def test_a_model_made_in_python_is_refused_in_the_same_words():
    with pytest.raises(BadInputError) as problem:
        Part(mass_kg=1.0, tooth=3)
    assert str(problem.value) == "Part: unknown key 'tooth'; did you mean 'teeth'?"


def test_counts_the_other_mistakes(written):
    with pytest.raises(DescriptionError, match=r"\(and 2 more\)$"):
        read(written("parts:\n- {mass_kg: -1}\n- {mass_kg: -2}\n- {mass_kg: -3}\n"))
