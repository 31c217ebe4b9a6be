"""Whether the ladle's mesh is of the size that the dimensions file says: the figures need no mesh, the picture does."""

import numpy as np

from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.robot.description.urdf import description_folder
from pouring_robot.robot.pouring.layout import Layout

# The mesh is made of flat facets, so its outline lies up to 0.3 % inside the true one.
_TOLERANCE = 0.005


def ladle_outline_m(layout: Layout) -> FloatArray:
    """Return the corners of the box around the ladle, in the frame ``ladle``: lower and upper, shape (2, 3), in m.

    The vessel hangs below its rim (z = 0); the pouring lip reaches out towards +x.
    """
    ladle = layout.ladle
    rim = ladle.outer_radius_top_m + ladle.rim_flange_m
    lip = max(rim, ladle.outer_radius_top_m + ladle.lip_reach_m)
    return np.array([[-rim, -rim, -ladle.height_m], [lip, rim, 0.0]])


def stale_mesh_note(layout: Layout) -> str | None:
    """Return a line that says so if the ladle's mesh has another size than the dimensions file; otherwise None."""
    path = description_folder() / "meshes" / layout.ladle.mesh
    if not path.is_file():  # whoever draws it says that it is missing
        return None
    import trimesh  # takes half a second to import

    wanted = ladle_outline_m(layout)
    found = np.asarray(trimesh.load_mesh(path).bounds)
    off = np.abs(found - wanted).max()
    if off <= _TOLERANCE * np.abs(wanted).max():
        return None
    return (
        f"the ladle is drawn from {layout.ladle.mesh}, which is {off * 1e3:.0f} mm off the dimensions in "
        f"{layout.path.name}; make it anew with scripts/make_meshes.py --layouts FILE (figures are not concerned)"
    )
