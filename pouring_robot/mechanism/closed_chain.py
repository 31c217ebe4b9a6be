"""A closed-chain mechanism: a URDF tree and the loops that close it, in Pinocchio, immutable once built.

In the URDF one chain carries the moving platform, because a URDF must be a tree. The real platform is carried by all
chains alike. So the joint that carries it (``cut_joints`` of the loops file) is cut: it becomes a floating joint, every
chain, the carrying one included, is closed onto the platform by a loop, and results do not depend on the choice of the
carrying chain.
"""

import functools
import threading
from collections.abc import Callable, Collection, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal, Self

import numpy as np
import pinocchio as pin

from pouring_robot.exceptions import BadInputError, DescriptionError, UnknownFrameError, UnknownJointError, closest
from pouring_robot.io.argument_checks import expect
from pouring_robot.io.units import LARGEST
from pouring_robot.mechanism.arrays import FloatArray, Indices, as_columns, numbers
from pouring_robot.mechanism.joint_types import unit_of
from pouring_robot.mechanism.loops_file import LoopsFile, LoopSpec, LoopStiffness
from pouring_robot.mechanism.pinocchio_model import displace_model, frame_index, tree_of


def _composed(first: Mapping[str, pin.SE3], second: Mapping[str, pin.SE3]) -> dict[str, pin.SE3]:
    """Return the composition of displacements, the first before the second."""
    return dict(first) | {name: first[name] * pose if name in first else pose for name, pose in second.items()}


class ClosedChainMechanism:
    """URDF and loops as one immutable object; all state that changes is in the solvers built on it.

    Methods that take a name raise UnknownFrameError or UnknownJointError where the robot has no such frame or joint.

    Args:
        urdf: the robot as URDF text, before any displacement.
        loops: the declaration of loops and drives.
        source: the file to name in error messages.
        displacements: of joints, fixed or moving, from their placements in the URDF: the pose of the actual placement
            in the URDF's.
        built_in: displacements from the drawing that the URDF already contains; closures need them if they are large.
        home: joint values, in m or rad; locked joints are held at theirs, or at zero without one.

    Attributes:
        tree_urdf: the URDF with cut joints floating and ``joint_types`` applied; spherical ones turn about one axis.
        mimics: joints that follow others.
        anchors: frames a and b of each loop, where it is closed, each fixed to a joint of the tree.
        shared_model: Pinocchio's model itself, for solvers of this package: read it, never change it.
        drawn: properties of the drawing once computed, shared by mechanisms displaced from one another.

    Raises:
        DescriptionError: Pinocchio cannot build the URDF, or the loops name absent frames or joints.
    """

    def __init__(
        self,
        urdf: str,
        loops: LoopsFile,
        source: Path | str = "loops.yaml",
        displacements: Mapping[str, pin.SE3] = MappingProxyType({}),
        built_in: Mapping[str, pin.SE3] = MappingProxyType({}),
        home: Mapping[str, float] = MappingProxyType({}),
    ) -> None:
        expect(urdf, str, "a mechanism is made of the text of a URDF")
        expect(loops, LoopsFile, "the loops of a mechanism are a LoopsFile, such as load_loops reads")
        self.urdf, self.loops, self._source, self._home = urdf, loops, Path(source), dict(home)
        self._workspace, self.drawn = threading.local(), dict[str, int]()
        self.tree_urdf, self.mimics, self.shared_model = tree_of(urdf, loops, self._source)
        self._displacements, self._built_in = dict(displacements), dict(built_in)
        for name in displacements:
            self.require_placement(name)
        displace_model(self.shared_model, displacements)
        self.anchors = self._find_anchors()
        for name in (loops.base_frame, *loops.reported_frames):
            self._declared(self.frame_id, name, f"'{name}' is not a frame of the robot")
        bodies = [self.shared_model.frames[self.frame_id(name)].parentJoint for name in loops.reported_frames]
        for name, body in zip(loops.reported_frames, bodies, strict=True):
            if body != bodies[0]:
                said = f"joints lie between '{loops.reported_frames[0]}' and the tool frame '{name}'"
                raise DescriptionError(self._source, f"{said}; name frames fixed to it, or another end_frame")
        self._drive_ids, self._locked_ids = (
            tuple(self._declared(self.joint_id, name, f"'{name}' is not a moving joint of the robot") for name in names)
            for names in (loops.drives, loops.locked_joints)
        )
        for name, joint in zip(loops.drives, self._drive_ids, strict=True):
            if self.shared_model.joints[joint].nv != 1:
                raise DescriptionError(self._source, f"drive '{name}' must have one freedom")
        self._check_mimics()

    def __reduce__(self) -> tuple[type[Self], tuple[Any, ...]]:
        """Pickle the arguments it was built from: Pinocchio's constraint models cannot be pickled."""
        return type(self), (self.urdf, self.loops, self._source, self._displacements, self._built_in, self._home)

    def displaced(self, displacements: Mapping[str, pin.SE3]) -> Self:
        """Return the mechanism with joints displaced further, faster than building one; raises as require_placement."""
        for name in displacements:
            self.require_placement(name)
        other = self._twin()
        other.shared_model = self.shared_model.copy()
        displace_model(other.shared_model, displacements)
        other.anchors = other._find_anchors()
        other._displacements = _composed(self._displacements, displacements)
        return other

    def _twin(self, **loops: Any) -> Self:
        """Return a copy with another base or stiffness; no name or index depends on them or on joint placements."""
        twin = object.__new__(type(self))
        twin.__dict__.update(self.__dict__)
        twin.loops = self.loops.model_copy(update=loops)
        return twin

    @property
    def errors(self) -> dict[str, pin.SE3]:
        """Displacements of joints from the drawing: the pose of the actual placement in the drawn one, by joint."""
        return _composed(self._built_in, self._displacements)

    def with_stiffness(self, stiffness: LoopStiffness) -> Self:
        """Return the mechanism with other stiffness of its closures; joint placements do not depend on it."""
        return self._twin(stiffness=stiffness)

    def seen_from(self, base: str) -> Self:
        """Return the same mechanism with poses seen from another frame."""
        return self._twin(base_frame=base)

    def with_drives(self, drives: tuple[str, ...]) -> Self:
        """Return the mechanism with other drives, or none: the closure finds joints that are no longer driven."""
        loops = self.loops.model_copy(update={"drives": drives})
        return type(self)(self.urdf, loops, self._source, self._displacements, self._built_in, self._home)

    def require_placement(self, joint: str) -> None:
        """Raise UnknownJointError for an absent joint, BadInputError for a cut one: displacing it changes nothing."""
        if joint not in self.joint_paths:
            raise UnknownJointError(joint, self.joint_paths)
        if joint in self.loops.cut_joints:
            raise BadInputError(
                f"joint '{joint}' is cut, so displacing it changes nothing; displace the platform's seats"
            )

    def _check_mimics(self) -> None:
        for mimic in self.mimics:
            if any(len(self.joint_columns.get(name, ())) != 1 for name in (mimic.joint, mimic.leader)):
                problem = f"joint '{mimic.joint}' mimics '{mimic.leader}': both must be joints of one freedom"
                if mimic.leader not in self.joint_paths:
                    problem += f", and there is no '{mimic.leader}'{closest(mimic.leader, self.joint_paths)}"
                raise DescriptionError(f"URDF of {self._source}", problem)
            if mimic.joint in self.loops.drives:
                raise DescriptionError(
                    self._source, f"drive '{mimic.joint}' mimics '{mimic.leader}' in the URDF; drive that one instead"
                )

    def _declared(self, find: Callable[[str], int], name: str, problem: str) -> int:
        """Return the index of a part that the loops file names."""
        try:
            return find(name)
        except (UnknownFrameError, UnknownJointError) as unknown:
            raise DescriptionError(self._source, problem + closest(name, unknown.known)) from unknown

    def _find_anchors(self) -> tuple[tuple[pin.Frame, pin.Frame], ...]:
        def frame(loop: LoopSpec, name: str) -> pin.Frame:
            absent = f"loop '{loop.name}' names the absent frame '{name}'"
            return self.shared_model.frames[self._declared(self.frame_id, name, absent)]

        return tuple((frame(loop, loop.frame_a), frame(loop, loop.frame_b)) for loop in self.loops.loops)

    def frames_at(self, configuration: FloatArray) -> pin.Data:
        """Return poses of joints and frames at a configuration (nq,), valid until this thread's next call."""
        if not hasattr(self._workspace, "data"):
            self._workspace.data = self.shared_model.createData()
        pin.framesForwardKinematics(self.shared_model, self._workspace.data, configuration)
        return self._workspace.data

    def copy_model(self) -> pin.Model:
        """Return a copy of the Pinocchio model, free to change."""
        return self.shared_model.copy()

    @functools.cached_property
    def joint_columns(self) -> dict[str, range]:
        """Velocity indices of every moving joint by name."""
        model = self.shared_model
        return {
            str(model.names[j]): range(model.idx_vs[j], model.idx_vs[j] + model.nvs[j]) for j in range(1, model.njoints)
        }

    @functools.cached_property
    def drive_columns(self) -> Indices:
        """Velocity indices of the drives, in the order of the loops file."""
        return np.array([self.shared_model.idx_vs[j] for j in self._drive_ids], dtype=np.intp)

    @functools.cached_property
    def passive_columns(self) -> Indices:
        """Velocity indices that the closure determines: neither driven nor locked, nor following another joint."""
        fixed = {*self._drive_ids, *self._locked_ids, *(self.joint_id(mimic.joint) for mimic in self.mimics)}
        free = (own for j, own in enumerate(self.joint_columns.values(), start=1) if j not in fixed)
        return np.array([column for own in free for column in own], dtype=np.intp)

    @functools.cached_property
    def closing_columns(self) -> Indices:
        """Velocity indices of all joints that are not locked: drives and passive joints together."""
        return np.sort(np.concatenate([self.drive_columns, self.passive_columns]))

    @functools.cached_property
    def coupling(self) -> FloatArray:
        """How all joints move with those that lead, shape (nv, nv): the unit matrix, but for joints that mimic."""
        coupling = np.eye(self.shared_model.nv)
        for mimic in self.mimics:
            follower, leader = (self.joint_columns[name].start for name in (mimic.joint, mimic.leader))
            coupling[follower, follower], coupling[follower, leader] = 0.0, mimic.ratio
        return coupling

    def columns_on(self, path: Collection[str]) -> FloatArray:
        """Return 1 for each velocity column of a joint on a path, else 0; (nv,)."""
        return np.array([name in path for name, own in self.joint_columns.items() for _ in own], dtype=float)

    @functools.cached_property
    def frame_paths(self) -> dict[str, tuple[str, ...]]:
        """Every frame by name: the names of the joints, moving and fixed, from the root down to it, it included."""
        joints, others = self._paths
        return joints | others

    @property
    def joint_paths(self) -> dict[str, tuple[str, ...]]:
        """The same for every joint, moving and fixed; a link may have the name of a joint elsewhere."""
        return self._paths[0]

    @functools.cached_property
    def seen_joints(self) -> frozenset[str]:
        """Joints that carry either the base frame or a reported or loop frame, not both; none that is cut."""
        paths, loops = self.frame_paths, self.loops
        frames = (*loops.reported_frames, *loops.loop_frames)
        carriers = ({*paths[loops.base_frame]} ^ {*paths[frame]} for frame in frames)
        return frozenset().union(*carriers).difference(loops.cut_joints)

    @functools.cached_property
    def _paths(self) -> tuple[dict[str, tuple[str, ...]], dict[str, tuple[str, ...]]]:
        paths: list[tuple[str, ...]] = []
        joints: dict[str, tuple[str, ...]] = {}
        others: dict[str, tuple[str, ...]] = {}
        for i, frame in enumerate(self.shared_model.frames):  # Pinocchio lists a frame after its parent
            before = paths[frame.parentFrame] if i else ()
            is_joint = frame.type in (pin.FrameType.JOINT, pin.FrameType.FIXED_JOINT)
            paths.append((*before, frame.name) if is_joint else before)
            (joints if is_joint else others)[frame.name] = paths[-1]
        return joints, others

    def unit_of(self, joint: str) -> Literal["m", "rad"]:
        """Return the unit of a one-freedom joint: a length or an angle."""
        return unit_of(self.shared_model.joints[self.joint_id(joint)])

    def placement_on_end(self, frame: str) -> pin.SE3:
        """Return the pose of a frame fixed to the end body in the loops file's ``end_frame``.

        Raises BadInputError where joints lie between the two.
        """
        end, wanted = (self.shared_model.frames[self.frame_id(name)] for name in (str(self.loops.end_frame), frame))
        if wanted.parentJoint != end.parentJoint:
            raise BadInputError(f"'{frame}' moves against '{self.loops.end_frame}'; name a frame that is fixed to it")
        return end.placement.actInv(wanted.placement)

    def frame_id(self, name: str) -> int:
        """Return Pinocchio's index of a frame; raises UnknownFrameError if there is none of that name."""
        expect(name, str, "a frame is asked for by its name")
        model = self.shared_model
        if not model.existFrame(name):
            raise UnknownFrameError(name, (frame.name for frame in model.frames))
        return frame_index(model, name)

    @property
    def T_end_tool(self) -> pin.SE3:
        """Pose of the frame that counts on the body that closes the loops (the pouring lip on the platform)."""
        return self.placement_on_end(str(self.loops.working_frame))

    def joint_id(self, name: str) -> int:
        """Return Pinocchio's index of a moving joint; raises UnknownJointError if there is none of that name."""
        expect(name, str, "a joint is asked for by its name")
        if not self.shared_model.existJointName(name):
            raise UnknownJointError(name, list(self.shared_model.names)[1:])
        return int(self.shared_model.getJointId(name))

    def pose_world_to_placement(self, data: pin.Data, joint: str) -> pin.SE3:
        """Return the pose of a joint's placement, before its own motion, from up-to-date frames of ``data``."""
        if self.shared_model.existJointName(joint):
            index = self.shared_model.getJointId(joint)
            return data.oMi[self.shared_model.parents[index]] * self.shared_model.jointPlacements[index]
        return data.oMf[self.frame_id(joint)]

    def pose_base_to_end(self, configuration: FloatArray) -> pin.SE3:
        """Return the pose of the end frame in the base frame at a configuration, shape (nq,)."""
        frames = self.frames_at(configuration).oMf
        base, end = (frames[self.frame_id(str(n))] for n in (self.loops.base_frame, self.loops.end_frame))
        return base.actInv(end)

    def neutral_configuration(self) -> FloatArray:
        """Return the configuration with every joint at zero, locked ones at their held values; shape (nq,)."""
        held = {name: self._home[name] for name in self.loops.locked_joints if name in self._home}
        return self.with_joint_values(pin.neutral(self.shared_model), held)

    def with_joint_values(self, configuration: FloatArray, values: Mapping[str, float]) -> FloatArray:
        """Return a copy of a configuration with the given one-freedom joints set (m or rad); shape (nq,).

        Raises UnknownJointError for an absent joint, BadInputError for one of several freedoms, values that are not a
        mapping or not finite, or a configuration of another length.
        """
        count = self.shared_model.nq
        result = numbers(configuration, (count,), f"a configuration of this robot has shape ({count},)")
        expect(values, Mapping, "values of joints, in m and rad, are a mapping by their names")
        for name, value in values.items():
            joint = self.shared_model.joints[self.joint_id(name)]
            if not isinstance(value, float | int | np.floating | np.integer) or not np.isfinite(value):
                raise BadInputError(f"joint '{name}': the value must be a finite number, not {value}")
            if joint.nv != 1:
                raise BadInputError(f"joint '{name}' has {joint.nv} freedoms; only one-freedom joints can be set")
            # A joint without limits ('continuous' in URDF) is stored as cosine and sine.
            stored = (value,) if joint.nq == 1 else (np.cos(value), np.sin(value))
            result[joint.idx_q : joint.idx_q + joint.nq] = stored
        return result

    def with_mimics(self, configuration: FloatArray, values: Mapping[str, float]) -> FloatArray:
        """Return a configuration (nq,) with joints that mimic others at the values that follow from their leaders.

        ``values`` (m, rad) may include whole turns, which a configuration does not hold.
        """
        if not self.mimics:
            return configuration
        known = self.joint_values(configuration) | dict(values)
        return self.with_joint_values(configuration, self.follower_values(known))

    def follower_values(self, values: Mapping[str, float]) -> dict[str, float]:
        """Return the values (m or rad) of only those joints that mimic joints of known values."""
        return {m.joint: m.ratio * values[m.leader] + m.offset for m in self.mimics if m.leader in values}

    def with_followers(self, offsets: Mapping[str, float]) -> dict[str, float]:
        """Return offsets of joints (m or rad), with those that follow for joints that mimic them."""
        return {**offsets, **{m.joint: m.ratio * offsets[m.leader] for m in self.mimics if m.leader in offsets}}

    @property
    def endless(self) -> tuple[str, ...]:
        """Joints that turn without limits, whose whole turns a configuration does not hold."""
        return tuple(name for name, _, count, freedoms in self._moving if count > freedoms == 1)

    @functools.cached_property
    def _moving(self) -> tuple[tuple[str, int, int, int], ...]:
        """Every moving joint: its name, its first coordinate, its number of coordinates, and its freedoms."""
        model = self.shared_model  # whose vectors are slow to be gone through
        parts = list(model.names)[1:], list(model.idx_qs)[1:], list(model.nqs)[1:], list(model.nvs)[1:]
        return tuple(zip(*parts, strict=True))

    def joint_values(self, configuration: FloatArray) -> dict[str, float]:
        """Return the value of every one-freedom joint by name, in m or rad."""
        return {name: float(value) for name, value in self.joint_courses(configuration).items()}

    def joint_courses(self, configurations: FloatArray) -> dict[str, FloatArray]:
        """Return the values of every one-freedom joint by name, (...) each in m or rad, from configurations (..., nq).

        A joint without limits ('continuous' in URDF) is stored as cosine and sine.
        """
        stored = {
            name: [configurations[..., first + k] for k in range(count)]
            for name, first, count, freedoms in self._moving
            if freedoms == 1
        }
        return {name: own[0] if len(own) == 1 else np.arctan2(own[1], own[0]) for name, own in stored.items()}

    def joint_axes(self, joints: Sequence[int]) -> FloatArray:
        """Return the first motion of joints, by Pinocchio's indices, in their own frames at zero: twists, (n, 6)."""
        model, data = self.shared_model, self.shared_model.createData()
        pin.computeJointJacobians(model, data, pin.neutral(model))
        columns = [as_columns(pin.getJointJacobian(model, data, j, pin.LOCAL))[:, model.idx_vs[j]] for j in joints]
        return np.array(columns).reshape(-1, 6)

    def named_drives(self, values: FloatArray) -> dict[str, float]:
        """Return drive values (drives,), in m and rad, by name."""
        return dict(zip(self.loops.drives, values.tolist(), strict=True))

    def joint_limits(self) -> dict[str, tuple[float, float]]:
        """Return lower and upper limit of every one-freedom joint with limits, in m or rad."""
        limits = np.transpose([self.shared_model.lowerPositionLimit, self.shared_model.upperPositionLimit])
        edges = {name: limits[k] for name, k, count, _ in self._moving if count == 1}
        # Programs that draw robots write 1e16 where there is none.
        return {name: tuple(pair.tolist()) for name, pair in edges.items() if np.abs(pair).max() <= LARGEST}
