"""Helpers that ask a bench and compare its answer with a location."""

import base64

import numpy as np

from pouring_robot.mechanism.poses import bodies_at

POSE = {"x_mm": -90.0, "y_mm": 10.0, "z_mm": -610.0, "tilt_deg": 12.0}


def ask(bench, values=None, commanded="pose", errors=None, settled=False):
    """Return the answer to a page whose other sliders are at their start."""
    shown = {s["id"]: s["value"] for group in bench.sliders()["groups"] for s in group["sliders"]}
    wish = {"commanded": commanded, "settled": settled, "values": shown | (values or {}), "errors": errors or {}}
    return bench.answer(wish)


def origins(answer, robot):
    """Return the positions of the origins of all bodies in an answer, (bodies, 3), in m."""
    packed = answer["film"]["robots"][robot]
    places, errors = (
        np.array([np.frombuffer(base64.b64decode(one), "<f4")[:3] for one in packed[key]], dtype=float)
        for key in ("places", "errors")
    )
    return places + errors


def check(answer, location):
    for name, closed in (("actual", location.actual), ("nominal", location.nominal)):
        wanted = bodies_at(closed.mechanism.shared_model, [closed.configuration])[0]
        np.testing.assert_allclose(origins(answer, name), wanted[:, :3, 3], atol=1e-6)
