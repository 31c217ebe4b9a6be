"""Another project's closure compared with ours in one run: Gepetto's toolbox-parallel-robots, as cloned from GitHub.

Its package imports CasADi for all of its functions; the SciPy ones need none, and are what runs here.
"""

from __future__ import annotations

import contextlib
import importlib
import io
import sys
import time
import types
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.closed_chain import ClosedChainMechanism

_NOT_NEEDED = {"casadi": "MX", "pinocchio.casadi": "Model", "qpsolvers": "solve_qp"}


@dataclass(frozen=True)
class ToolboxFindings:
    """What the toolbox found for some targets.

    Attributes:
        targets: their number.
        closed: those it leaves open by less than the limit asked for.
        residual: largest component left open, in m or rad; the median over the targets.
        seconds: of one closure, on average.
    """

    targets: int
    closed: int
    residual: float
    seconds: float


def load_toolbox(folder: Path) -> Any:
    """Import the toolbox from its clone, with empty modules in place of what it imports but does not need here."""
    for name, member in _NOT_NEEDED.items():
        try:
            importlib.import_module(name)
        except ImportError:
            sys.modules[name] = types.ModuleType(name)
            setattr(sys.modules[name], member, type(member, (), {}))
            if name == "pinocchio.casadi":
                pin.casadi = sys.modules[name]
    sys.path.insert(0, str(folder))
    return importlib.import_module("toolbox_parallel_robots")


def close_with(toolbox: Any, mechanism: ClosedChainMechanism, targets: FloatArray, limit: float) -> ToolboxFindings:
    """Close a mechanism for drive values by the toolbox's SciPy forward kinematics.

    It starts from the neutral pose: with NumPy 2 the toolbox takes no other start.

    Args:
        toolbox: as :func:`load_toolbox` gives it.
        mechanism: the mechanism; its drives turn and slide by one number each.
        targets: drive values, in m or rad, shape (n, drives).
        limit: largest component that may be left open, in m or rad.
    """
    model = mechanism.copy_model()
    data = model.createData()
    kinds = {"3d": pin.ContactType.CONTACT_3D, "6d": pin.ContactType.CONTACT_6D}
    contacts = [
        pin.RigidConstraintModel(
            kinds[loop.type], model, a.parentJoint, a.placement, b.parentJoint, b.placement, pin.ReferenceFrame.LOCAL
        )
        for loop, (a, b) in zip(mechanism.loops.loops, mechanism.anchors, strict=True)
    ]
    contact_data = [contact.createData() for contact in contacts]
    names = mechanism.loops.drives
    actuation = toolbox.ActuationModel(model, list(names))
    order = np.argsort([mechanism.joint_id(name) for name in names])  # the toolbox takes drives in the model's order
    residuals, began = [], time.perf_counter()
    for target in targets:
        with contextlib.redirect_stdout(io.StringIO()):
            found = toolbox.closedLoopForwardKinematicsScipy(
                model, data, contacts, contact_data, actuation, target[order], None
            )
        left = toolbox.constraintsResidual(model, data, contacts, contact_data, pin.normalize(model, found))
        residuals.append(np.abs(left).max())
    spent = (time.perf_counter() - began) / len(targets)
    return ToolboxFindings(len(targets), int(np.sum(np.array(residuals) < limit)), float(np.median(residuals)), spent)
