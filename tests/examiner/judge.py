"""The judge: how large a fault is in units of noise, and which effects a campaign cannot distinguish.

Both are linear tests of the examiner's own: two unknown frames of six parameters are eliminated; an effect explains a
displacement if a plausible amount of its textbook columns leaves no detectable residual.
"""

import numpy as np

from tests.examiner.machine import HOME_B as HOME
from tests.examiner.machine import along, skew, step

DETECTABLE = 9.0  # sum of squares of a rest in units of noise: three standard deviations of one parameter


def rotation_vectors(R):
    """Return rotation vectors (..., 3) of small rotations (..., 3, 3)."""
    w = 0.5 * np.stack([R[..., 2, 1] - R[..., 1, 2], R[..., 0, 2] - R[..., 2, 0], R[..., 1, 0] - R[..., 0, 1]], axis=-1)
    sine = np.linalg.norm(w, axis=-1, keepdims=True)
    return w * np.where(sine > 1e-12, np.arcsin(np.minimum(sine, 1.0)) / np.maximum(sine, 1e-300), 1.0)


class Judge:
    """Measures differences of sights in units of the scene's noise, the two frames fitted away."""

    def __init__(self, rig):
        """Hold the frames' columns at the rig's nominal poses."""
        self.rig, self.scene = rig, rig.scene
        sight = rig.see(faults=[], weight=False)
        n = len(sight.x)
        columns = np.zeros((n, 6, 12))
        columns[:, :3, :3] = np.eye(3)
        columns[:, :3, 3:6] = -skew(sight.x - sight.x.mean(axis=0))
        columns[:, :3, 6:9] = sight.R
        columns[:, 3:, 3:6] = np.swapaxes(sight.R, -1, -2)
        columns[:, 3:, 9:] = np.eye(3)
        basis, sizes, _ = np.linalg.svd(self.flat(columns), full_matrices=False)
        self.frames = basis[:, sizes > 1e-9 * sizes[0]]

    def flat(self, rows):
        """Return rows (n, 6, …) of position and rotation in units of noise, (coordinates, …)."""
        turned = self.scene.sigma_turn
        parts = [rows[:, :3] / self.scene.sigma] + ([rows[:, 3:] / turned] if turned else [])
        return np.concatenate(parts, axis=1).reshape(-1, *rows.shape[2:])

    def free(self, y):
        """Return y (coordinates, …) without what the two frames explain."""
        return y - self.frames @ (self.frames.T @ y)

    def gap(self, before, after):
        """Return the difference of two sights in units of noise, frames fitted away."""
        turns = rotation_vectors(np.swapaxes(before.R, -1, -2) @ after.R)
        return self.free(self.flat(np.concatenate([after.x - before.x, turns], axis=1)))

    def ratio(self, before, after):
        """Return the rms of that."""
        return float(np.sqrt(np.mean(self.gap(before, after) ** 2)))

    def rms_mm(self, before, after):
        """Return the rms of a position's coordinate of that, mm."""
        return float(1e3 * self.scene.sigma * np.sqrt(np.mean(self.positions(self.gap(before, after)) ** 2)))

    def positions(self, y):
        """Return the positions' share of flat rows (coordinates,)."""
        return y.reshape(len(self.scene.time), -1)[:, :3]

    def transfer(self):
        """Return what single local changes do: {name: (n, 6)} by one condensed step of the springs from rest."""
        rig = self.rig
        parts, state = rig.rest(faults=[], weight=False)
        h = 1e-6
        back = rig.tracker @ state.R @ rig.target

        def probe(name, place, amount):
            changed = parts.copy()
            getattr(changed, name)[(slice(None), *place)] += amount
            _, move, _ = step(changed, state, rig.springs)
            x = along(rig.tracker, move[:, :3] + np.cross(move[:, 3:], along(state.R, rig.seat)))
            turns = along(np.swapaxes(back, -1, -2), along(rig.tracker, move[:, 3:]))
            return np.concatenate([x, turns], axis=1) / h

        out = {f"length{i}": probe("length", (i,), h) for i in range(3)}
        out["tilt"] = probe("tilt", (), h)
        for leg in range(4):
            for name in "AB":
                out |= {f"{name}{leg}{k}": probe(name, (leg, k), h) for k in range(3)}
            for name, axes in (("S1", (0, 2)), ("S5", (0, 2)), ("S2", (1, 2)), ("S4", (1, 2)), ("cross", (0, 1))):
                out |= {f"{name}{leg}{k}": probe(name, (leg, k), h) for k in axes}
        p = state.p + along(state.R, rig.seat)
        for k in range(6):
            twist = np.eye(6)[k]
            shift = along(rig.tracker, twist[:3] + np.cross(twist[3:], p))
            turns = along(np.swapaxes(back, -1, -2), np.broadcast_to(rig.tracker @ twist[3:], p.shape))
            out[f"base{k}"] = np.concatenate([shift, turns], axis=1)
        out["scale"] = np.concatenate([rig.stand + along(rig.tracker, p), np.zeros_like(p)], axis=1)
        self.loads = rig.rest(faults=[])[1]
        return out

    def columns(self):
        """Return {effect: textbook columns (n, 6, k) scaled by a plausible dose}."""
        s, t = self.scene, self.transfer()
        L, tilt, q = [t[f"length{i}"] for i in range(3)], t["tilt"], s.drives
        hot, warm = s.legs - s.cold, s.platform - s.cold
        clock = (s.time - s.time[0]) / max(np.ptp(s.time), 1.0)
        grow = [sum(t[f"B{i}{k}"] * HOME[i, k] for i in range(4)) for k in range(2)]
        load, u, waves = s.weight / 5000.0, s.travel / s.span, (np.sin, np.cos)
        sag = 16 * (u * (1 - u)) ** 2
        bent = (("base2", sag), ("base3", 16 * u * (1 - u) * (1 - 2 * u) / s.span), ("base4", sag / 3))
        shapes = {
            "drive_zero_offset": [(5e-3, 1, c) for c in [*L, tilt]],
            "drive_scale": [(4e-3, q[:, i], L[i]) for i in range(3)],
            "drive_cyclic": [(5e-4, f(2 * np.pi * q[:, i] / s.pitch), L[i]) for i in range(3) for f in waves],
            "drive_backlash": [(1e-3, s.approach[:, i], [*L, tilt][i]) for i in range(4)],
            "joint_centre_offset": [(3e-3, 1, c) for name, c in t.items() if name[0] in "AB"],
            "joint_axis_tilt": [(3e-3, 1, c) for name, c in t.items() if name[0] in "Sc" and name != "scale"],
            "leg_thermal_expansion": [(2e-5, q[:, i] * hot[:, i], L[i]) for i in range(3)],
            "platform_thermal_expansion": [(2e-5, warm, c) for c in grow],
            "leg_compliance": [(3e-7, q[:, i] * self.loads.axial[:, i], L[i]) for i in range(3)],
            "tilt_drive_compliance": [(3e-6, self.loads.moment, tilt)],
            "truss_deflection": [(5e-3, w * shape, t[base]) for w in (1, load) for base, shape in bent],
            "base_drift": [(3e-3, clock, t[f"base{k}"]) for k in range(6)],
            "tilt_encoder_eccentricity": [(5e-3, f(q[:, 3]), tilt) for f in waves],
            "metrology_scale": [(3e-3, 1, t["scale"])],
        }  # fmt: skip

        def stacked(shape):
            return np.stack([dose * np.broadcast_to(c, len(q))[:, None] * g for dose, c, g in shape], axis=-1)

        return {name: stacked(shape) for name, shape in shapes.items()}

    def alike(self, y):
        """Return {effect: rest} of what plausible doses of each effect leave of y, a flat gap, their price included."""
        out = {}
        for name, columns in self.columns().items():
            X = self.free(self.flat(columns))
            dose = np.linalg.solve(X.T @ X + np.eye(X.shape[1]), X.T @ y)
            out[name] = float(np.sum((y - X @ dose) ** 2) + np.sum(dose**2))
        return out
