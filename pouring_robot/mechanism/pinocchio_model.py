"""Pinocchio's model of a URDF: ``mimic`` joints, the parser's messages, joints displaced in the model.

A xacro was converted to a URDF before, in ``robot/description/xacro_to_urdf.py``; joints of types other than the URDF's
are made in :mod:`~pouring_robot.mechanism.joint_types`.
"""

import contextlib
import functools
import os
import sys
import tempfile
import threading
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pinocchio as pin
from lxml import etree

from pouring_robot.exceptions import DescriptionError, UnknownJointError
from pouring_robot.mechanism.gravity import GRAVITY
from pouring_robot.mechanism.joint_types import NOT_IN_URDF, change_joints, make_spherical
from pouring_robot.mechanism.loops_file import LoopsFile

# The parser writes to the process's standard error, of which there is one.
_lock = threading.Lock()


@dataclass(frozen=True)
class Mimic:
    """A joint that follows another: its value is ``ratio`` times the leader's plus ``offset`` (m or rad)."""

    joint: str  # the follower
    leader: str  # what it follows, itself free to move
    ratio: float  # of the two values
    offset: float  # in m or rad


def read_mimics(urdf: str, source: Path | str) -> tuple[Mimic, ...]:
    """Return joints that mimic others, chains resolved to the first leader; raises DescriptionError if one is wrong."""
    own = {}
    for tied in etree.fromstring(urdf.encode()).xpath("joint[not(@type='fixed')]/mimic[1]"):
        name = str(tied.getparent().get("name"))
        try:
            ratio, offset = float(tied.get("multiplier", 1.0)), float(tied.get("offset", 0.0))
        except ValueError as problem:
            why = f"joint '{name}': multiplier and offset of mimic must be numbers"
            raise DescriptionError(source, why) from problem
        own[name] = Mimic(name, str(tied.get("joint")), ratio, offset)
    return tuple(_resolved(mimic, own, source) for mimic in own.values())


def _resolved(mimic: Mimic, every: Mapping[str, Mimic], source: Path | str) -> Mimic:
    for _ in every:
        if mimic.leader not in every:
            return mimic
        above = every[mimic.leader]
        mimic = Mimic(mimic.joint, above.leader, mimic.ratio * above.ratio, mimic.ratio * above.offset + mimic.offset)
    raise DescriptionError(source, f"joint '{mimic.joint}' mimics itself by way of others; let one of them be free")


def tree_of(urdf: str, loops: LoopsFile, source: Path) -> tuple[str, tuple[Mimic, ...], pin.Model]:
    """Return a URDF with joints as the loops state them, those that mimic, and its model, which the caller may change.

    Raises DescriptionError where a joint is absent, or, with its parser's message, Pinocchio cannot build the URDF.
    """
    *read, model = _tree_of(urdf, tuple(loops.joint_types.items()), tuple(loops.cut_joints), source)
    return *read, model.copy()


@functools.lru_cache(maxsize=32)  # one command asks for the same robot many times
def _tree_of(
    urdf: str, kinds: tuple[tuple[str, str], ...], cut: tuple[str, ...], source: Path
) -> tuple[str, tuple[Mimic, ...], pin.Model]:
    changed = dict(kinds) | dict.fromkeys(cut, "floating")
    try:
        tree_urdf = change_joints(urdf, changed)
        mimics = read_mimics(tree_urdf, f"URDF of {source}")
    except UnknownJointError as problem:
        key = "cut_joints" if problem.name in cut else "joint_types"
        raise DescriptionError(source, f"{key}: {problem}") from problem
    except etree.XMLSyntaxError as problem:
        raise DescriptionError(f"URDF of {source}", f"not valid XML: {problem}") from problem
    model, spherical = model_of(tree_urdf, source), {name for name, kind in changed.items() if kind in NOT_IN_URDF}
    return tree_urdf, mimics, make_spherical(model, spherical) if spherical else model


def model_of(urdf: str, source: Path) -> pin.Model:
    """Return Pinocchio's model of a URDF, under standard gravity; joints without limits in it are unlimited.

    Raises DescriptionError, with the parser's message, where Pinocchio cannot build it.
    """
    words: list[str] = []
    try:
        with _heard(words):
            model = pin.buildModelFromXML(urdf)
    except (ValueError, RuntimeError) as problem:
        why = "; ".join([line.removeprefix("Error:").strip() for line in words] or [str(problem)])
        raise DescriptionError(f"URDF of {source}", f"Pinocchio cannot build it: {why}") from problem
    for line in words:  # it took the URDF, but not without a word
        print(line, file=sys.stderr)
    model.gravity.linear = np.array(GRAVITY)
    unsaid = model.lowerPositionLimit >= model.upperPositionLimit  # 0 and 0 is what a URDF has that leaves them out
    model.lowerPositionLimit = np.where(unsaid, -np.inf, model.lowerPositionLimit)
    model.upperPositionLimit = np.where(unsaid, np.inf, model.upperPositionLimit)
    return model


@contextlib.contextmanager
def _heard(words: list[str]) -> Iterator[None]:
    """Collect the lines that a library writes to standard error in the block."""
    with _lock, tempfile.TemporaryFile() as heard:
        if sys.stderr is not None:  # closed by whoever started the process
            sys.stderr.flush()
        saved = os.dup(2)
        os.dup2(heard.fileno(), 2)
        try:
            yield
        finally:
            os.dup2(saved, 2)
            os.close(saved)
            heard.seek(0)
            words += [line for line in heard.read().decode(errors="replace").splitlines() if line.strip()]


def frame_index(model: pin.Model, name: str) -> int:
    """Return Pinocchio's index of an existing frame; where joint and link have the same name, it is the link's."""
    link = pin.FrameType.BODY
    return int(model.getFrameId(name, link) if model.existFrame(name, link) else model.getFrameId(name))


def displace_model(model: pin.Model, displacements: Mapping[str, pin.SE3]) -> None:
    """Displace joints, fixed and moving, with all they carry, by poses in their present placements, in place."""
    before = [frame.placement.copy() for frame in model.frames]
    moved = [False] * len(before)  # frames that no longer stand where they stood on their joint
    for i in range(1, len(before)):
        frame = model.frames[i]
        own, parent = displacements.get(frame.name), frame.parentFrame
        is_joint, is_fixed = frame.type == pin.FrameType.JOINT, frame.type == pin.FrameType.FIXED_JOINT
        if not is_joint and not is_fixed:
            own = None  # a link may bear the name of a joint
        if own is None and not moved[parent]:
            continue
        present = model.jointPlacements[frame.parentJoint] if is_joint else before[i]
        placement = model.frames[parent].placement * before[parent].actInv(present)
        if own is not None:
            placement = placement * own
        if is_joint:  # what it carries stays where it is on it
            model.jointPlacements[frame.parentJoint] = placement
            continue
        moved[i], frame.placement = True, placement
        if frame.inertia.mass > 0.0:
            _move_mass(model, frame, before[i])


def _move_mass(model: pin.Model, frame: pin.Frame, before: pin.SE3) -> None:
    """Move the body behind a fixed joint, which Pinocchio has merged into the moving one; parameters are additive."""
    joint = frame.parentJoint
    total = model.inertias[joint].toDynamicParameters()
    total += frame.placement.act(frame.inertia).toDynamicParameters()
    total -= before.act(frame.inertia).toDynamicParameters()
    model.inertias[joint] = pin.Inertia.FromDynamicParameters(total)
