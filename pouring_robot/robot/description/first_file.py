"""A first robot file for a user's URDF: what can be read from it, and comments on what to fill in."""

import itertools
import json
import os
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import pinocchio as pin
from lxml import etree

from pouring_robot.exceptions import DescriptionError
from pouring_robot.io.typed_yaml import parse_yaml, validate
from pouring_robot.mechanism.closed_chain import ClosedChainMechanism
from pouring_robot.mechanism.joint_types import BOUNDED, UNITS
from pouring_robot.mechanism.loops_file import LoopsFile, load_loops
from pouring_robot.mechanism.pinocchio_model import read_mimics
from pouring_robot.report.page import templates
from pouring_robot.robot.description.definition import RobotDefinition
from pouring_robot.robot.description.robot_file import FORMAT, TAKEN, RobotFile
from pouring_robot.robot.description.urdf import carriers, check_sound, limits_said, parsed, read_urdf
from pouring_robot.robot.description.xacro_to_urdf import run_xacro

_TOOLS = ("tool0", "tcp", "tool", "flange", "ee", "end_effector")  # usual names of the last frame, likeliest first

NO_MAPPINGS: Mapping[str, str] = MappingProxyType({})
_TOGETHER = 1e-6  # m and rad
_DEGREES_RAD = 30.0
"""Limits beyond this, five turns, are questioned: no joint of an arm has them in rad, but every one in degrees."""
_WORDS = r"true|false|yes|no|on|off|null|y|n|[.](\d.*|inf|nan)"  # that YAML does not read as text


class _Tree:
    """Links and joints of a URDF."""

    def __init__(self, path: Path, text: str) -> None:
        self.root = parsed(text, path)
        joints = [joint for joint in self.root.iterfind("joint") if joint.get("type")]
        if self.root.tag != "robot" or not joints:
            raise DescriptionError(
                path, ("is not a URDF with joints; give the URDF, or a file whose name ends in .xacro")
            )
        check_sound(self.root, path)
        name, times = Counter(str(joint.get("name")) for joint in joints).most_common(1)[0]
        if times > 1:
            raise DescriptionError(path, f"{times} joints are called '{name}'; each needs a name of its own")
        self.joints = {str(joint.get("name")): joint for joint in joints}
        self.above = {_link(joint, "child"): joint for joint in joints}
        for name, joint in self.joints.items():
            if not (_link(joint, "parent") and _link(joint, "child")):
                raise DescriptionError(path, f"joint '{name}' does not say which two links it joins")
        children = Counter(_link(joint, "child") for joint in joints)
        carried = carriers(self.root, *(_link(joint, "parent") for joint in joints))
        for link, joint in self.above.items():
            if children[link] > 1 or joint.get("name") in carried[_link(joint, "parent")]:
                why = "has several parent joints" if children[link] > 1 else "is carried by itself"
                raise DescriptionError(
                    path, (f"link '{link}' {why}; a URDF is a tree, and loops are closed in the robot file")
                )

    def moving(self, link: str) -> list[str]:
        """Return the moving joints on the way from the root down to a link."""
        way = (self.joints[name] for name in reversed(carriers(self.root, link)[link]) if name in self.joints)
        return [str(joint.get("name")) for joint in way if joint.get("type") != "fixed"]

    def ends(self) -> list[str]:
        """Return the links at which the tree ends: those with a usual name of a tool first, then those that move most.

        The fingers of a gripper move more than the tool between them.
        """
        parents = {_link(joint, "parent") for joint in self.joints.values()}
        leaves = [link for link in self.above if link not in parents and self.moving(link)]

        def rank(link: str) -> tuple[int, int]:
            names = [k for k, name in enumerate(_TOOLS) if re.search(rf"(^|[^a-z]){name}([^a-z]|$)", link.lower())]
            return min(names, default=len(_TOOLS)), -len(self.moving(link))

        return sorted(leaves, key=rank)

    def homes(self) -> dict[str, float]:
        """Return the middle of the range (m, rad) of each joint whose limits exclude zero."""
        leading = {name: joint for name, joint in self.joints.items() if joint.find("mimic") is None}
        bounded = {n: limits_said(j) for n, j in leading.items() if j.get("type") in BOUNDED}
        return {name: (low + up) / 2.0 for name, (low, up) in bounded.items() if not low <= 0.0 <= up}

    def degrees(self) -> dict[str, str]:
        """Return the limits, in words, of joints whose limits may be in degrees."""
        turning = {name: limits_said(joint) for name, joint in self.joints.items() if joint.get("type") == "revolute"}
        return {name: f"{low:g} to {up:g} rad" for name, (low, up) in turning.items() if max(-low, up) > _DEGREES_RAD}


def _link(joint: etree._Element, end: str) -> str:
    found = joint.find(end)
    return "" if found is None else str(found.get("link"))


def first_robot(urdf: Path, path: Path, mappings: Mapping[str, str] = NO_MAPPINGS) -> tuple[str, RobotDefinition]:
    """Return the text of a robot file, to be written to ``path``, for a URDF or xacro, and the robot that it defines.

    Raises DescriptionError like :func:`first_robot_file`, or where the robot cannot be loaded, e.g. because of meshes.
    """
    text = first_robot_file(urdf, path.parent, mappings)
    return text, RobotDefinition(validate(RobotFile, parse_yaml(text, path), path), path)


def first_robot_file(urdf: Path, beside: Path, mappings: Mapping[str, str] = NO_MAPPINGS) -> str:
    """Return the text of a robot file for a URDF or a xacro, with paths relative to the folder ``beside``.

    Loops are taken from a Gepetto ``robot.yaml`` in the URDF's folder (see :func:`loops_beside`); otherwise end links
    that coincide in the zero pose are proposed in a comment. Raises DescriptionError where the URDF cannot be read,
    Pinocchio cannot build it, nothing in it moves, or ``mappings``, arguments of a xacro, are given for a URDF.
    """
    rendered = urdf.suffix == ".xacro"
    if mappings and not rendered:
        raise DescriptionError(
            urdf, ("is not a xacro, by its name, and only xacros have arguments; leave out the mappings")
        )
    text = run_xacro(urdf, mappings) if rendered else read_urdf(urdf)
    tree = _Tree(urdf, text)
    ends = tree.ends()
    if not ends:
        raise DescriptionError(urdf, "no joint of it moves a link at the end of the tree")
    end, *others = ends
    path, closed = tree.moving(end), loops_beside(urdf)
    if closed is None:  # what floats or rolls below an arm is not a drive: poses are relative to what it carries
        kinds = [tree.joints[name].get("type") for name in path]
        path = path[max((k for k, kind in enumerate(kinds, start=1) if kind not in UNITS), default=0) :]
    # A joint that mimics another is driven by it, wherever that is: a telescope's is often in a separate branch.
    mimics = {mimic.joint: mimic.leader for mimic in read_mimics(text, urdf)}
    led = dict.fromkeys(mimics.get(name, name) for name in path)
    drives = [name for name in led if name in tree.joints and tree.joints[name].get("type") in UNITS]
    if closed is not None:
        drives = list(dict.fromkeys(mimics.get(name, name) for name in load_loops(closed).drives)) or drives
    if not drives:
        raise DescriptionError(urdf, f"no joint on the way to '{end}' slides or turns by itself; a drive must")
    aside = [name for link in ends for name in tree.moving(link) if name not in {*path, *led, *mimics}]
    name = re.sub(r"[^A-Za-z0-9_.-]", "_", str(tree.root.get("name") or urdf.stem)).lstrip("_.-") or "robot"
    base, locked = _link(tree.joints[path[0]], "parent"), () if closed else tuple(dict.fromkeys(aside))
    said: dict[str, Any] = {"mechanism": name, "base_frame": base, "end_frame": end, "drives": tuple(drives)}
    file = load_loops(closed) if closed else LoopsFile(loops=(), locked_joints=locked, **said)
    mechanism = ClosedChainMechanism(text, file.model_copy(update=said), urdf)  # before a file is written
    environment = templates("pouring_robot.robot")
    environment.filters["quoted"] = _quoted
    return environment.get_template("robot.yaml.j2").render(
        format=FORMAT,
        name=name,
        drawing="xacro" if rendered else "urdf",
        urdf=os.path.relpath(urdf, beside),
        mappings=mappings,
        base=base,
        end=end,
        others=others,
        meetings=() if closed else _meetings(mechanism, (end, *others)),
        loops=os.path.relpath(closed, beside) if closed else "",
        locked=locked,
        drives={name: _column(name, drives) for name in drives},
        homes=tree.homes(),
        degrees=tree.degrees(),
    )


def loops_beside(urdf: Path) -> Path | None:
    """Return Gepetto's ``robot.yaml`` in a URDF's folder, which declares its loops; None where there is none."""
    path = urdf.parent / "robot.yaml"
    text = path.read_text(encoding="utf-8", errors="replace") if path.is_file() else ""
    return path if re.search(r"^closed_loop\s*:", text, re.MULTILINE) else None


def _meetings(mechanism: ClosedChainMechanism, ends: Sequence[str]) -> list[tuple[str, str, str]]:
    """Return pairs of end links that coincide in the zero pose: two names, and 6d where axes coincide too, else 3d."""
    frames, found = mechanism.frames_at(mechanism.neutral_configuration()).oMf, list[tuple[str, str, str]]()
    for a, b in itertools.combinations(ends, 2):
        motion = pin.log6(frames[mechanism.frame_id(a)].actInv(frames[mechanism.frame_id(b)]))
        if np.linalg.norm(motion.linear) < _TOGETHER:
            found.append((a, b, "6d" if np.linalg.norm(motion.angular) < _TOGETHER else "3d"))
    return found


def _quoted(name: str) -> str:
    """Return a name or path as YAML text: in quotes where YAML might not read it back as text."""
    plain = re.fullmatch(r"[A-Za-z_./][\w./-]*", name) and not re.fullmatch(_WORDS, name, re.IGNORECASE)
    return name if plain else json.dumps(name)


def _column(name: str, drives: Sequence[str]) -> str:
    """Return a column for a drive whose joint has a name that campaigns use for something else, otherwise ""."""
    if name not in TAKEN:
        return ""
    column = f"{name}_drive"
    while column in drives:
        column += "_"
    return column
