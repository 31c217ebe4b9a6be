"""README and docs are correct: blocks run, output is as printed, links resolve, commands and paths exist."""

import ast
import importlib
import re
import shutil
import tomllib

import pytest
from ruamel.yaml import YAML

from pouring_robot.campaign.metadata import CampaignMetadata
from pouring_robot.cli.app import main
from pouring_robot.robot.description.robot_file import RobotFile
from pouring_robot.robot.model import RobotModel
from pouring_robot.sweeps import SweepConfig
from scripts.site_pages import exported
from tests.docs.shown import assert_shown, commands, fences, what_it_prints
from tests.support import ROOT

PAGES = [ROOT / "README.md", ROOT / "CHANGELOG.md", *sorted((ROOT / "docs").rglob("*.md"))]
PAGES += [ROOT / "robot_description" / "README.md", *sorted((ROOT / "examples").rglob("README.md"))]
WITH_BLOCKS = [page for page in PAGES if "```console" in page.read_text() or "```python" in page.read_text()]
TOLD_TWICE = (ROOT / "README.md", ROOT / "docs" / "diagnosis.md")
"""Pages that show the same commands: these run once for both."""
# Shown and not run here, with the reason; by a part of the command or the block.
SLOW = {
    "make demo": "makes an environment",
    "make test": "runs all tests",
    "pouring-robot calibrate measured.csv": "needs the plan",
    "series_c.csv --robot examples/machines/ur10/robot.yaml --out": "see tests/diagnosis/test_measured_arm",
    "series_c.csv --model": "see tests/diagnosis/test_measured_arm",
    "diagnose examples/machines/hangprinter/samples.csv": "see tests/examples/test_hangprinter",
    "pouring-robot campaign plan": "takes half a minute; see tests/design",
    "pouring-robot campaign simulate --plan plan.csv": "needs the plan",
    "pouring-robot campaign check measured.csv": "needs the plan",
    "pouring-robot pose --at-mm -100 20 -600 --tilt-deg 17 --model calibrated/calibrated.yaml": "needs the calibration",
    "pouring-robot compensate examples/poses.csv": "warms five poses; see tests/cli",
    "--after-min 30 --png heat.png": "follows the heat over time; see tests/cli",
    "pouring-robot sweep examples/sweep.yaml": "takes two minutes; see tests/sweeps",
    "diagnose(campaign)": "takes half a minute; see tests/diagnosis",
    'sweep("examples/sweep.yaml"': "takes two minutes; see tests/sweeps",
    "ErrorTable.read_csv(": "needs the paper's thermal study",
    "pouring-robot regress output/": "needs the paper's thermal study",
    "--thermal-model law.yaml": "needs the paper's thermal study",
}


def why_slow(text: str) -> str | None:
    """Return why a command or block is not run, or None."""
    return next((why for part, why in SLOW.items() if part in text), None)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """An empty folder with the examples in it."""
    shutil.copytree(ROOT / "examples", tmp_path / "examples")
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize(
    "pages",
    [TOLD_TWICE, *((page,) for page in WITH_BLOCKS if page not in TOLD_TWICE)],
    ids=lambda pages: str(pages[0].relative_to(ROOT)),
)
def test_what_a_page_shows_is_what_happens(pages, folder, capfd, monkeypatch, undrawn):
    monkeypatch.setenv("COLUMNS", "120")
    names, printed = {}, {}
    for page in pages:
        for kind, text in fences(page, "console", "python", "csv"):
            if kind == "csv":
                (folder / "shift.csv").write_text(text)
            elif kind == "python" and not why_slow(text):
                exec(compile(text, page.name, "exec"), names)
                said, shown = capfd.readouterr().out, re.findall(r"# (<.*>)$", text, flags=re.MULTILINE)
                assert [line for line in shown if line not in said] == []
            for command, shown in commands(text) if kind == "console" else ():
                own = command.removeprefix(".venv/bin/")
                if not why_slow(command):
                    if own not in printed:
                        printed[own] = what_it_prints(own, capfd)
                    assert_shown(shown, printed[own])


def test_every_reason_has_its_block():
    shown = "\n".join(text for page in WITH_BLOCKS for _, text in fences(page, "console", "python"))
    assert [start for start in SLOW if start not in shown] == []


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_commands_and_options_mentioned_exist(page, capfd):
    helped = {}
    for line in re.findall(r"pouring-robot ((?:campaign |robot )?[a-z]+[^`\n|]*)", page.read_text()):
        names = re.match(r"(?:campaign |robot )?[a-z]+", line)[0]
        if names not in helped:
            assert main([*names.split(), "--help"]) == 0, line
            helped[names] = capfd.readouterr().out
        assert [option for option in re.findall(r"--[\w-]+", line) if option not in helped[names]] == [], line


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_resolve(page):
    for target in re.findall(r"\]\(([^)\s]+)\)", page.read_text()):
        if "://" in target:
            continue
        path, _, heading = target.partition("#")
        other = (page.parent / path).resolve() if path else page
        assert other.exists(), f"{page.name}: {target}"
        if heading:
            headings = re.findall(r"^#+ (.*)$", other.read_text(), flags=re.MULTILINE)
            assert heading in [re.sub(r"[^\w\- ]", "", h.lower()).replace(" ", "-") for h in headings], target


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_paths_and_modules_mentioned_exist(page):
    text = page.read_text() if page.stem != "CHANGELOG" else ""
    for path in re.findall(
        r"(?<!format: )\b((?:pouring_robot|robot_description|scripts|examples|tests)/[\w./-]*\w)", text
    ):
        assert (ROOT / path).exists(), f"{page.name}: {path}"


def test_where_the_house_says_something_is_there_is_a_file():
    where = (ROOT / "docs" / "house.md").read_text().partition("## Where is")[2].partition("\n## ")[0]
    paths = re.findall(r"`([\w/]+(?:\.py|\.yaml|/))`", where)
    assert len(paths) > 100
    assert [path for path in paths if not ((ROOT / "pouring_robot" / path).exists() or (ROOT / path).exists())] == []


def test_every_page_is_in_the_navigation_of_the_site_once():
    site = YAML(typ="safe").load((ROOT / "mkdocs.yml").read_text(encoding="utf-8"))
    listed = [page for section in site["nav"] for part in section.values() for page in part]
    pages = {str(page.relative_to(ROOT / "docs")) for page in (ROOT / "docs").rglob("*.md")}
    assert sorted(listed) == sorted(pages | {"api.md", "changelog.md"})
    assert (ROOT / site["hooks"][0]).is_file()


def test_the_site_lists_what_the_package_exports():
    import pouring_robot

    listed = exported()
    assert {name.rpartition(".")[2] for name in listed} == set(pouring_robot.__all__) - {"__version__"}
    for name in listed:
        module, _, defined = name.rpartition(".")
        assert getattr(importlib.import_module(module), defined).__doc__, name


def test_yaml_blocks_are_valid_files():
    kinds = {"pouring_robot/model/1": RobotModel, "pouring_robot/sweep/1": SweepConfig}
    found = [YAML(typ="safe").load(text) for page in PAGES for _, text in fences(page, "yaml")]
    assert {block.get("format") for block in found} == {*kinds, None}
    for block in found:
        if "format" in block:
            kinds[block["format"]].model_validate(block)
        else:
            assert set(block) <= set(CampaignMetadata.model_fields) | {"metrology", "drives", "truss", "ladle"}


def test_the_rooms_are_listed_in_the_order_of_imports():
    layers = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"][0]["layers"]
    listed = re.findall(
        r"^\| `pouring_robot/(\w+)(?:/|\.py)` \|", (ROOT / "docs" / "house.md").read_text(), re.MULTILINE
    )
    assert listed == layers[::-1]


def test_no_other_room_names_a_leg():
    """In its code: help and docstrings may say what is the pouring robot's."""
    rooms = ("robot/pouring", "thermal")
    named = re.compile(r"(^|_)legs?\d?(_|$)", re.IGNORECASE)
    for path in (ROOT / "pouring_robot").rglob("*.py"):
        if path.relative_to(ROOT / "pouring_robot").as_posix().startswith(rooms):
            continue
        fields = (vars(node) for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))))
        words = [one[key] for one in fields for key in ("id", "attr", "arg", "name") if isinstance(one.get(key), str)]
        assert not [word for word in words if named.search(word)], path


def test_the_keys_that_a_robot_file_needs_are_marked():
    table = (ROOT / "docs" / "any_robot.md").read_text().partition("## The robot file")[2].partition("\n## ")[0]
    marked = set(re.findall(r"`(\w+)` \*", table))
    needed = {name for name, field in RobotFile.model_fields.items() if field.is_required()}
    assert marked == needed | {"urdf", "base_frame", "end_frame"}  # the latter as RobotFile checks them together


@pytest.mark.parametrize(
    "index", sorted((ROOT / "docs").rglob("index.md")), ids=lambda page: str(page.relative_to(ROOT))
)
def test_pages_are_on_the_map(index):
    pages = {page.name for page in index.parent.glob("*.md")} - {"index.md"}
    assert [name for name in sorted(pages) if name not in index.read_text()] == []
