"""The machine: a fixed platform, four legs and a moving platform as free bodies, held together by stiff springs.

Every leg is a separate body with seven degrees of freedom (six of its housing, one of its spindle); the platform has
six. A Hooke's joint constrains its centre (three springs) and the right angle between its two axes (one torsion spring
along the cross); a drive holds a spindle or the angle of cross 4. No loop is cut and no chain carries the platform: the
springs share the over-constraint of four U-P-U chains, as in a real frame. The static pose is the stationary point of
spring energy and loads, found by Gauss-Newton steps in which each leg is condensed onto the platform.
"""

from dataclasses import dataclass, fields

import numpy as np

LEGS = 4
HOME_A = np.array([[-0.340, 0.374, 0.0], [-0.340, -0.374, 0.0], [0.340, 0.374, 0.0], [0.340, -0.374, 0.0]])
HOME_B = np.array([[-0.1825, 0.330, 0.0], [-0.1825, -0.330, 0.0], [0.1825, 0.330, 0.0], [0.1825, -0.330, 0.0]])
BOX = np.array([[-0.150, -0.050], [-0.050, 0.050], [-0.825, -0.425], [-0.4884, 1.08155]])
DOWN = np.array([0.0, 0.0, -1.0])
GRAVITY = 9.80665


class NoEquilibriumError(RuntimeError):
    """The springs found no static pose; the commanded drives are out of reach."""


def skew(v):
    """Return the matrices of v × (..., 3, 3) for vectors (..., 3)."""
    m = np.zeros((*v.shape, 3))
    m[..., 0, 1], m[..., 0, 2], m[..., 1, 2] = -v[..., 2], v[..., 1], -v[..., 0]
    m[..., 1, 0], m[..., 2, 0], m[..., 2, 1] = v[..., 2], -v[..., 1], v[..., 0]
    return m


def turn(v):
    """Return the rotations (..., 3, 3) of rotation vectors (..., 3), rad (Rodrigues)."""
    angle = np.linalg.norm(v, axis=-1)[..., None, None]
    k = skew(v)
    return np.eye(3) + np.sinc(angle / np.pi) * k + 0.5 * np.sinc(angle / (2 * np.pi)) ** 2 * (k @ k)


def along(R, v):
    """Return R v for stacks (..., 3, 3) and (..., 3)."""
    return np.einsum("...ij,...j->...i", R, v)


def unit(v):
    """Return v (..., 3) scaled to length 1."""
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


def drives_of(pose):
    """Return commanded l1, l2, l3 (m) and θ46 (rad), (n, 4), of nominal poses x, y, z (m), tilt (rad), (n, 4)."""
    tilts = np.zeros((len(pose), 3))
    tilts[:, 1] = pose[:, 3]
    d = pose[:, None, :3] + np.einsum("nij,kj->nki", turn(tilts), HOME_B) - HOME_A
    psi4 = np.arctan2(-d[:, 3, 0], -d[:, 3, 2])
    return np.column_stack([np.linalg.norm(d[:, :3], axis=-1), pose[:, 3] - psi4])


@dataclass
class Parts:
    """The parts as they are in every row (first axis n): what faults, heat and loads change. SI units."""

    A: np.ndarray  # (n, 4, 3) upper joint centres in the fixed platform
    B: np.ndarray  # (n, 4, 3) lower joint centres in the moving platform
    S1: np.ndarray  # (n, 4, 3) first axis of the upper joint, in the fixed platform
    S2: np.ndarray  # (n, 4, 3) second axis of the upper joint, in the leg
    S4: np.ndarray  # (n, 4, 3) first axis of the lower joint, in the leg
    S5: np.ndarray  # (n, 4, 3) second axis of the lower joint, in the moving platform
    cross: np.ndarray  # (n, 4, 2) cosine between the two axes of the upper and of the lower cross
    foot: np.ndarray  # (n, 4, 3) where the lower centre stands off the spindle's axis, in the leg
    length: np.ndarray  # (n, 3) spindle positions the drives hold
    tilt: np.ndarray  # (n,) angle of cross 4 the tilt drive holds
    force: np.ndarray  # (n, 3) on the moving platform's origin, in the fixed platform's frame
    torque: np.ndarray  # (n, 3) likewise
    base: np.ndarray  # (n, 6) small move of the fixed platform in the hall: translation, rotation vector
    mark: np.ndarray  # (n, 3) move of the target on the moving platform, in its frame
    scale: np.ndarray  # (n,) error of the measuring device's scale

    def copy(self):
        """Return parts that can be changed apart."""
        return Parts(**{f.name: getattr(self, f.name).copy() for f in fields(self)})


def drawing(drives):
    """Return the parts as drawn, cold and unloaded, for commanded drives (n, 4)."""
    n = len(drives)

    def each(row):
        return np.broadcast_to(np.asarray(row, float), (n, LEGS, 3)).copy()

    return Parts(
        A=each(HOME_A), B=each(HOME_B), S1=each([0, 1, 0]), S2=each([1, 0, 0]), S4=each([1, 0, 0]), S5=each([0, 1, 0]),
        cross=np.zeros((n, LEGS, 2)), foot=np.zeros((n, LEGS, 3)), length=drives[:, :3].copy(),
        tilt=drives[:, 3].copy(), force=np.zeros((n, 3)), torque=np.zeros((n, 3)), base=np.zeros((n, 6)),
        mark=np.zeros((n, 3)), scale=np.zeros(n),
    )  # fmt: skip


@dataclass(frozen=True)
class Springs:
    """What holds the bodies together: N/m and N·m/rad."""

    centre: float = 1e10
    cross: float = 5e7
    spindle: float = 1e10
    tilt: float = 1e9

    def matrix(self):
        """Return the ten stiffnesses of every leg, (4, 10); leg 4 has no spindle drive, the others no tilt drive."""
        k = np.array([*[self.centre] * 3, self.cross, *[self.centre] * 3, self.cross, self.spindle, 0.0])
        rows = np.tile(k, (LEGS, 1))
        rows[3, 8:] = 0.0, self.tilt
        return rows

    def stiffer(self, factor):
        """Return springs that many times as stiff."""
        return Springs(self.centre * factor, self.cross * factor, self.spindle * factor, self.tilt * factor)


@dataclass
class State:
    """Where the bodies are, row by row."""

    p: np.ndarray  # (n, 3) moving platform
    R: np.ndarray  # (n, 3, 3)
    P: np.ndarray  # (n, 4, 3) legs, at their upper joint centre
    Q: np.ndarray  # (n, 4, 3, 3)
    s: np.ndarray  # (n, 4) spindles
    axial: np.ndarray | None = None  # (n, 3) tension in the driven legs, N
    moment: np.ndarray | None = None  # (n,) with which the tilt drive is turned forward, N·m

    def moved(self, legs, platform):
        """Return the state after small moves of the legs (n, 4, 7) and the platform (n, 6)."""
        return State(
            self.p + platform[:, :3], turn(platform[:, 3:]) @ self.R,
            self.P + legs[..., :3], turn(legs[..., 3:6]) @ self.Q, self.s + legs[..., 6],
        )  # fmt: skip


def start(pose):
    """Return the bodies at nominal poses x, y, z, tilt (n, 4)."""
    tilts = np.zeros((len(pose), 3))
    tilts[:, 1] = pose[:, 3]
    R = turn(tilts)
    up = HOME_A - pose[:, None, :3] - np.einsum("nij,kj->nki", R, HOME_B)
    z = unit(up)
    x = unit(np.cross([0.0, 1.0, 0.0], z))
    Q = np.stack([x, np.cross(z, x), z], axis=-1)
    return State(pose[:, :3].copy(), R, np.broadcast_to(HOME_A, up.shape).copy(), Q, np.linalg.norm(up, axis=-1))


def strains(parts, state):
    """Return strains (n, 4, 10) of all springs and their derivatives by the legs (…, 7) and the platform (…, 6)."""
    n = len(state.p)
    e, jl, jp = np.zeros((n, LEGS, 10)), np.zeros((n, LEGS, 10, 7)), np.zeros((n, LEGS, 10, 6))
    Qt = np.swapaxes(state.Q, -1, -2)
    # Upper centre, seen from the leg: Qᵀ(P − A).
    e[..., :3] = along(Qt, state.P - parts.A)
    jl[..., :3, :3] = Qt
    jl[..., :3, 3:6] = Qt @ skew(state.P - parts.A)
    s2 = along(state.Q, parts.S2)
    e[..., 3] = np.sum(parts.S1 * s2, axis=-1) - parts.cross[..., 0]
    jl[..., 3, 3:6] = np.cross(s2, parts.S1)
    # Lower centre: Qᵀ(p + R B − P) against the spindle's end.
    RB = along(state.R[:, None], parts.B)
    reach = state.p[:, None] + RB - state.P
    e[..., 4:7] = along(Qt, reach) - parts.foot - state.s[..., None] * DOWN
    jl[..., 4:7, :3] = -Qt
    jl[..., 4:7, 3:6] = Qt @ skew(reach)
    jl[..., 4:7, 6] = -DOWN
    jp[..., 4:7, :3] = Qt
    jp[..., 4:7, 3:] = -Qt @ skew(RB)
    s4, s5 = along(state.Q, parts.S4), along(state.R[:, None], parts.S5)
    e[..., 7] = np.sum(s4 * s5, axis=-1) - parts.cross[..., 1]
    jl[..., 7, 3:6] = np.cross(s4, s5)
    jp[..., 7, 3:] = -jl[..., 7, 3:6]
    # Drives: spindles 1 to 3; for leg 4 the angle of its cross about S5, counted from the platform's x.
    e[:, :3, 8] = state.s[:, :3] - parts.length
    jl[:, :3, 8, 6] = 1.0
    axis = parts.S5[:, 3]
    ahead = unit(np.cross(axis, [0.0, 0.0, 1.0]))
    aside = np.cross(ahead, axis)
    v = along(np.swapaxes(state.R, -1, -2), s4[:, 3])
    c, d = np.sum(v * ahead, axis=-1), np.sum(v * aside, axis=-1)
    e[:, 3, 9] = np.arctan2(d, c) - parts.tilt
    row = along(state.R, (c[:, None] * aside - d[:, None] * ahead) / (c * c + d * d)[:, None])
    jl[:, 3, 9, 3:6] = np.cross(s4[:, 3], row)
    jp[:, 3, 9, 3:] = -jl[:, 3, 9, 3:6]
    return e, jl, jp


def step(parts, state, springs):
    """Return the Gauss-Newton moves of legs (n, 4, 7) and platform (n, 6), and the strains."""
    e, jl, jp = strains(parts, state)
    kl, kp = (np.swapaxes(j * springs.matrix()[..., None], -1, -2) for j in (jl, jp))
    inner = np.linalg.solve(kl @ jl, np.concatenate([kl @ jp, kl @ e[..., None]], axis=-1))
    load = np.concatenate([parts.force, parts.torque], axis=-1)
    hessian = np.sum(kp @ jp - kp @ jl @ inner[..., :6], axis=1)
    pull = load - np.sum((kp @ e[..., None] - kp @ jl @ inner[..., 6:])[..., 0], axis=1)
    platform = np.linalg.solve(hessian, pull[..., None])[..., 0]
    return -inner[..., 6] - along(inner[..., :6], platform[:, None]), platform, e


def settle(parts, state, springs, tolerance=2e-9, most=60):
    """Return the state of rest; moves below the tolerance (m, rad) end the search.

    The last digits of the strains, 1e-16 m, already move the weak sideways freedom by 1e-10 m.

    Raises:
        NoEquilibriumError: after that many steps, or if the bodies fly apart.
    """
    for _ in range(most):
        legs, platform, _ = step(parts, state, springs)
        state = state.moved(legs, platform)
        largest = max(np.abs(platform).max(), np.abs(legs).max())
        if not largest < 0.5:
            break
        if largest < tolerance:
            e, _, _ = strains(parts, state)
            state.axial, state.moment = springs.spindle * e[:, :3, 8], springs.tilt * e[:, 3, 9]
            return state
    raise NoEquilibriumError("the bodies find no rest: take drives inside the workspace and smaller loads")
