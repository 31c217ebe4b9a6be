"""Where placement parameters act at one configuration, as twists in the world."""

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.closed_chain import ClosedChainMechanism
from pouring_robot.mechanism.closure.energy import TwistColumns
from pouring_robot.mechanism.parameters import LocalParameter, PlacementParameter


class PlacedTwists:
    """The placement parameters among n of any kind, whose others are zero here; frames in ``data`` are up to date.

    Its ``world`` is the twist per unit of each parameter, in world coordinates, shape (6, n). Raises as
    :meth:`ClosedChainMechanism.require_placement`.
    """

    def __init__(self, mechanism: ClosedChainMechanism, data: pin.Data, parameters: Sequence[LocalParameter]) -> None:
        self._mechanism, count = mechanism, len(parameters)
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

    def carried(self, frame: str) -> FloatArray:
        """Return 1 for each parameter that displaces a frame with all joints held, else 0; shape (n,)."""
        path = self._mechanism.frame_paths[frame]
        hangs = np.array([*(joint in path for joint in self._joints), False], dtype=float)
        return np.asarray(hangs[self._owner])

    def columns(self) -> TwistColumns:
        """Return the twists as the loops feel them."""
        mechanism, loops = self._mechanism, self._mechanism.loops.loops
        depths = np.array([*(mechanism.path_depths[joint] for joint in self._joints), 0.0])[self._owner]
        shape = (len(loops), 1, len(depths))
        on_a = np.reshape([self.carried(loop.frame_a) for loop in loops], shape)
        on_b = np.reshape([self.carried(loop.frame_b) for loop in loops], shape)
        return TwistColumns(self.world * on_a, self.world * on_b, depths)
