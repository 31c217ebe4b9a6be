r"""Effects of placement parameters at one configuration: twists in the world that act on the loops, and weight.

With :math:`V = -\sum_b m_b\, g \cdot c_b`, the gradient by a joint k is :math:`-m\, g \cdot v_k(c)` summed over the
bodies beyond it, with :math:`v_k(c)` the velocity its twist gives the centre of mass. Displacing a placement p
changes it by :math:`-m\, g \cdot (\omega_u \times v_d(c))` for every body beyond both, where u is the one of k and p
that comes first on the path and d the other.
"""

from collections.abc import Collection, Sequence

import numpy as np
import pinocchio as pin

from pouring_robot.mechanism.arrays import FloatArray, as_columns
from pouring_robot.mechanism.closed_chain import ClosedChainMechanism
from pouring_robot.mechanism.closure.energy import ClosureEnergy, TwistColumns
from pouring_robot.mechanism.local_parameters import LocalParameter, PlacementParameter
from pouring_robot.mechanism.rotations import moved_point


class PlacedTwists:
    """Twists of the placement parameters among n ``parameters``, 0 for the others; frames in ``data`` are current.

    Its ``world`` is the twist per unit of each parameter, in world coordinates, shape (6, n). Raises as
    :meth:`ClosedChainMechanism.require_placement`.
    """

    def __init__(self, mechanism: ClosedChainMechanism, data: pin.Data, parameters: Sequence[LocalParameter]) -> None:
        self._mechanism, self.parameters, count = mechanism, tuple(parameters), len(parameters)
        placed = [(k, p) for k, p in enumerate(parameters) if isinstance(p, PlacementParameter)]
        self._joints = tuple(dict.fromkeys(parameter.joint for _, parameter in placed))
        self.world, self._owner = np.zeros((6, count)), np.full(count, len(self._joints))
        if not placed:
            return
        actions = []
        for joint in self._joints:
            mechanism.require_placement(joint)
            actions.append(mechanism.pose_world_to_placement(data, joint).toActionMatrix())
        number = {joint: i for i, joint in enumerate(self._joints)}
        columns = [k for k, _ in placed]
        self._owner[columns] = [number[parameter.joint] for _, parameter in placed]
        twists = np.array([parameter.twist for _, parameter in placed])
        self.world[:, columns] = (np.stack(actions)[self._owner[columns]] @ twists[:, :, None])[:, :, 0].T

    def carried(self, path: Collection[str]) -> FloatArray:
        """Return 1 for each parameter that displaces the end of a path with joints held, else 0; (n,)."""
        hangs = np.array([*(joint in path for joint in self._joints), False], dtype=float)
        return np.asarray(hangs[self._owner])

    def columns(self) -> TwistColumns:
        """Return the twists as they act on the loops."""
        mechanism, paths, loops = self._mechanism, self._mechanism.frame_paths, self._mechanism.loops.loops
        depths = np.array([*(len(mechanism.joint_paths[joint]) - 1.0 for joint in self._joints), 0.0])[self._owner]
        shape = (len(loops), 1, len(depths))
        on_a = np.reshape([self.carried(paths[loop.frame_a]) for loop in loops], shape)
        on_b = np.reshape([self.carried(paths[loop.frame_b]) for loop in loops], shape)
        return TwistColumns(self.world * on_a, self.world * on_b, depths)


Body = tuple[float, FloatArray, tuple[str, ...]]
"""A mass, its centre in the world and the joints, fixed and moving, that carry it."""


class Weight:
    """The weight of the links under the loads of an energy, at the poses of joints and frames in its data."""

    def __init__(self, energy: ClosureEnergy) -> None:
        self._energy, self._mechanism, self._data = energy, energy.mechanism, energy.data
        self._gravity = np.array(energy.model.gravity.linear)
        self._bodies = self._links()
        if energy.loads.payload_kg > 0.0:
            self._bodies.append(self._payload(energy.loads.payload_kg))

    def _links(self) -> list[Body]:
        """Return the links one by one: Pinocchio has merged those behind fixed joints into their moving parent."""
        model, data, paths = self._mechanism.shared_model, self._data, self._mechanism.joint_paths
        bodies = list[Body]()
        merged = [pin.Inertia.Zero() for _ in range(model.njoints)]
        for i, frame in enumerate(model.frames):
            if frame.type == pin.FrameType.FIXED_JOINT and frame.inertia.mass > 0.0:
                merged[frame.parentJoint] += frame.placement.act(frame.inertia)
                bodies.append((frame.inertia.mass, data.oMf[i].act(frame.inertia.lever), paths[frame.name]))
        for joint in range(1, model.njoints):
            own_mass = model.inertias[joint].mass - merged[joint].mass
            if own_mass > 1e-12:
                moment = model.inertias[joint].mass * model.inertias[joint].lever
                lever = (moment - merged[joint].mass * merged[joint].lever) / own_mass
                bodies.append((own_mass, data.oMi[joint].act(lever), paths[model.names[joint]]))
        return bodies

    def _payload(self, mass: float) -> Body:
        name = self._energy.payload_frame
        frame = self._data.oMf[self._mechanism.frame_id(name)]
        return mass, frame.act(np.array(self._energy.loads.payload_centre_m)), self._mechanism.frame_paths[name]

    def payload_derivative(self) -> FloatArray:
        """Return the derivative of the gravity gradient by the payload's mass; shape (nv,), in N or Nm per kg."""
        _, centre, path = self._payload(1.0)
        velocities = moved_point(as_columns(self._data.J), centre) * self._mechanism.columns_on(path)
        return np.asarray(-self._gravity @ velocities)

    def placement_derivative(self, placed: PlacedTwists) -> FloatArray:
        """Return the derivative of the gravity gradient by placement parameters; shape (nv, n)."""
        motion, twists = as_columns(self._data.J), placed.world
        first = placed.columns().depth < self._energy.joint_depths[:, None]
        # g · (ω × v) = (g × ω) · v, of the one that comes first and the other
        by_joint, by_placement = (np.cross(self._gravity, part[3:], axisb=0) for part in (motion, twists))
        change = np.zeros(first.shape)
        for mass, centre, path in self._bodies:
            own, displaced = moved_point(motion, centre), moved_point(twists, centre)
            turned = np.where(first, own.T @ by_placement.T, by_joint @ displaced)
            change -= mass * turned * np.outer(self._mechanism.columns_on(path), placed.carried(path))
        return change
