"""Pinocchio's model of a URDF, what its parser says of one that it does not take, and joints displaced in the model."""

import contextlib
import functools
import os
import sys
import tempfile
import threading
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

import pinocchio as pin
from lxml import etree

from pouring_robot.exceptions import BadInputError, DescriptionError, UnknownJointError
from pouring_robot.mechanism.joint_types import Mimic, change_joints, make_spherical, read_mimics
from pouring_robot.mechanism.loops import LoopsFile

# The parser writes to the process's standard error, of which there is one.
_lock = threading.Lock()


class Tree(NamedTuple):
    """A robot without its closures: its URDF with the joints as loops want them, joints that mimic, and the model."""

    urdf: str
    mimics: tuple[Mimic, ...]
    model: pin.Model


def tree_of(urdf: str, loops: LoopsFile, source: Path) -> Tree:
    """Return the tree of a URDF text with joints as loops want them; the model is the caller's own.

    Raises:
        DescriptionError: a joint is absent, the text is no URDF, or Pinocchio cannot build it: says why in its
            parser's words.
    """
    tree = _tree_of(urdf, tuple(loops.joint_types.items()), tuple(loops.cut_joints), source)
    return tree._replace(model=tree.model.copy())


@functools.lru_cache(maxsize=32)  # one command asks for the same robot many times
def _tree_of(urdf: str, kinds: tuple[tuple[str, str], ...], cut: tuple[str, ...], source: Path) -> Tree:
    changed = dict(kinds) | dict.fromkeys(cut, "floating")
    try:
        tree_urdf = change_joints(urdf, changed)
        mimics = read_mimics(tree_urdf)
    except UnknownJointError as problem:
        key = "cut_joints" if problem.name in cut else "joint_types"
        raise DescriptionError(source, f"{key}: {problem}") from problem
    except etree.XMLSyntaxError as problem:
        raise DescriptionError(f"URDF of {source}", f"not valid XML: {problem}") from problem
    except BadInputError as problem:
        raise DescriptionError(f"URDF of {source}", str(problem)) from problem
    model, spherical = _parsed(tree_urdf, source), {name for name, kind in changed.items() if kind == "spherical"}
    return Tree(tree_urdf, mimics, make_spherical(model, spherical) if spherical else model)


def _parsed(urdf: str, source: Path) -> pin.Model:
    words: list[str] = []
    try:
        with _heard(words):
            model = pin.buildModelFromXML(urdf)
    except (ValueError, RuntimeError) as problem:
        why = "; ".join([line.removeprefix("Error:").strip() for line in words] or [str(problem)])
        raise DescriptionError(f"URDF of {source}", f"Pinocchio cannot build it: {why}") from problem
    for line in words:  # it took the URDF, but not without a word
        print(line, file=sys.stderr)
    return model


@contextlib.contextmanager
def _heard(words: list[str]) -> Iterator[None]:
    """Collect the lines that a library writes to standard error meanwhile."""
    with _lock, tempfile.TemporaryFile() as heard:
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
