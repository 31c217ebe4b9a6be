"""Sessions with frames of their own: the tracker was set up anew, so each session sees the base elsewhere.

Complete poses and positions are first transformed to the frame of the largest session, by the present robot
(:func:`in_one_frame`). The remaining errors of that are six more unknowns per session (:class:`SessionParameter`): the
displacement of the base in its own axes that the rows of this session see, fitted with everything else.
"""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from pouring_robot.campaign.columns import DISTANCE
from pouring_robot.campaign.data import Campaign
from pouring_robot.campaign.nominal import PoseStack
from pouring_robot.estimation.frames.fit import fit_frames
from pouring_robot.estimation.frames.starts import FEWEST_FOR_FRAMES
from pouring_robot.estimation.robust import PRELIMINARY_HUBER_BOUND, huber_weights
from pouring_robot.exceptions import CampaignError
from pouring_robot.mechanism.arrays import FloatArray, Indices, robust_sigma
from pouring_robot.mechanism.local_parameters import COMPONENTS, FrameParameter
from pouring_robot.mechanism.rotations import nearest_rotations, rotation_vectors

SESSION = "session "  # how the names of unknowns of a session begin
_ROUNDS = 12


@dataclass(frozen=True)
class SessionParameter(FrameParameter):
    """One of the six displacements of the base in a session, relative to the largest session."""

    session: str  # its name

    @property
    def name(self) -> str:
        """Such as ``session 2: base.tx``."""
        return f"{SESSION}{self.session}: {super().name}"


def session_parameters(campaign: Campaign) -> tuple[SessionParameter, ...]:
    """Return the unknowns of all sessions but the largest; none where all see the base in the same place."""
    others = by_size(campaign)[1:] if campaign.metadata.own_frames else []
    return tuple(SessionParameter("base", component, name) for name in others for component in COMPONENTS)


def numbers_of(sessions: Sequence[str], parameters: Sequence[SessionParameter]) -> Indices:
    """Return the number of each row's session among those that have unknowns, (n,); -1: it has none."""
    own = {name: k for k, name in enumerate(dict.fromkeys(p.session for p in parameters))}
    return np.array([own.get(name, -1) for name in sessions], dtype=np.intp)


def by_size(campaign: Campaign) -> list[str]:
    """Return the names of the sessions, the largest first, to whose frame the others are transformed.

    Those without a position or rotation are left out: distances between their rows do not depend on the frame.
    """
    seen = campaign.usable & (campaign.position_measured | campaign.rotation_measured).any(axis=1)
    names = [name for name, used in zip(campaign.sessions, seen, strict=True) if used]
    return sorted(dict.fromkeys(names), key=lambda name: -names.count(name))


def _too_few(campaign: Campaign, name: str) -> CampaignError:
    few = f"session '{name}' has fewer than {FEWEST_FOR_FRAMES} whole positions"
    unknown = "so its place of measurement is not known; measure more, or leave it out"
    return CampaignError(campaign.path, f"{few}, {unknown}")


def _refuse_lines_between_frames(campaign: Campaign) -> None:
    """Refuse distances from a fixed point, which differs between sessions, and from a row of another session."""
    if campaign.distance_m is None:
        return
    start, (_, session) = campaign.distance_start, np.unique(campaign.sessions, return_inverse=True)
    other = (start == -1) | (start >= 0) & (session != session[start])
    wrong = campaign.usable & np.isfinite(campaign.distance_m[:, 0]) & other
    if wrong.any():
        line, heading = int(campaign.lines[wrong.argmax()]), campaign.heading(DISTANCE)
        rule = "where each session has a frame of its own, a distance is from another row of the same session"
        mend = "name that in distance_from, or leave the cell empty"
        raise CampaignError(campaign.path, f"{rule}; {mend}", line, heading)


def in_one_frame(campaign: Campaign, poses: PoseStack) -> Campaign:
    """Return a campaign whose sessions all measure from the tracker's place in the largest one.

    A campaign with one frame is returned unchanged. ``poses`` are those of the present robot's end body in the base for
    every row, NaN where unknown.

    Raises:
        CampaignError: a session has too few complete positions to determine where it was measured from, or a distance
            is from a fixed point or another session.
        FrameFitError: too few rows of the largest session have drives that reach a pose.
    """
    if not campaign.metadata.own_frames or len(set(campaign.sessions)) < 2:
        return campaign
    _refuse_lines_between_frames(campaign)
    sessions, names = np.array(campaign.sessions), by_size(campaign)
    if len(names) < 2:
        return campaign
    measured = campaign.measured_poses
    largest = np.flatnonzero(sessions == names[0])
    if np.count_nonzero(campaign.usable[largest]) < FEWEST_FOR_FRAMES:
        raise _too_few(campaign, names[0])
    metres_per_rad, seen = campaign.metadata.metres_per_rad, measured[largest]
    first = fit_frames(poses[largest], seen.position_m, seen.rotation, metres_per_rad).frames
    target = PoseStack(first.places(poses), poses.rotation @ first.T_end_target.rotation)
    for name in names[1:]:
        rows = np.flatnonzero((sessions == name) & campaign.usable)
        T_tracker_base = _seen_from(target[rows], measured[rows], metres_per_rad)
        if T_tracker_base is None:
            raise _too_few(campaign, name)
        back = first.T_tracker_base * T_tracker_base.inverse()
        measured.position_m[rows] = measured.position_m[rows] @ back.rotation.T + back.translation
        measured.rotation[rows] = back.rotation @ measured.rotation[rows]
    turned = rotation_vectors(measured.rotation) if campaign.full_pose else None
    return dataclasses.replace(campaign, position_m=measured.position_m, rotation_vector_rad=turned)


def _seen_from(target: PoseStack, measured: PoseStack, metres_per_rad: float) -> pin.SE3 | None:
    """Return the pose of the base in the tracker that sees targets (base frame) as measured; None: too few rows.

    Rows have Huber weights; rotations, where measured, are weighted by ``metres_per_rad`` against positions.
    """
    used = target.complete & np.isfinite(measured.position_m).all(axis=1)
    if used.sum() < FEWEST_FOR_FRAMES:
        return None
    here, there = target[used], measured[used]
    turned = np.isfinite(there.rotation).all(axis=(1, 2))
    weights = np.ones(len(here))
    for _ in range(_ROUNDS):
        middle, seen = (np.average(stack.position_m, axis=0, weights=weights) for stack in (here, there))
        spread = np.einsum("n,ni,nj->ij", weights, there.position_m - seen, here.position_m - middle)
        turns = np.einsum("n,nij,nkj->ik", weights[turned], there.rotation[turned], here.rotation[turned])
        rotation = nearest_rotations(spread + metres_per_rad**2 * turns)
        base = pin.SE3(rotation, seen - rotation @ middle)
        misfit = np.linalg.norm(there.position_m - here.position_m @ base.rotation.T - base.translation, axis=1)
        sigma = robust_sigma(misfit / np.sqrt(3.0))
        weights = huber_weights(misfit, PRELIMINARY_HUBER_BOUND * np.sqrt(3.0) * sigma) if sigma else weights
    return base


def base_displacements(values: FloatArray, session: Indices) -> FloatArray:
    """Return the displacement of the base that each row sees, (n, 6), in m and rad.

    ``values`` are those of the session parameters, (6 s,); ``session`` is the number of each row's session among them,
    (n,), or -1.
    """
    return np.asarray(np.concatenate([values.reshape(-1, 6), np.zeros((1, 6))])[session])
