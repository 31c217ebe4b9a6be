"""The pouring robot's description: xacro and dimensions file in, URDF out, without ROS."""

import functools
import importlib.metadata
from collections.abc import Sequence
from pathlib import Path

from pouring_robot.exceptions import DescriptionError
from pouring_robot.io.cache import content_key, kept_text
from pouring_robot.robot.description.urdf import MESH_PACKAGE, description_folder, read_text
from pouring_robot.robot.pouring.layout import check_layout, shipped_layouts_file
from pouring_robot.robot.pouring.names import CHAINS


def render_urdf(
    layout: str = "paper",
    *,
    chain_order: Sequence[int] = (1, 2, 3, 4),
    layouts_file: Path | None = None,
    mesh_folder: Path | None = None,
) -> str:
    """Return the robot's URDF.

    Rendering takes half a second; the result is kept on disk by a hash of everything it depends on, so a changed
    file is seen and an unchanged one is rendered once a machine. Safe to call from several threads.

    Args:
        layout: name of a layout in the dimensions file.
        chain_order: the four chains; the first carries the moving platform in the tree, the others
            close on it.
        layouts_file: dimensions file (default: the shipped one).
        mesh_folder: folder written into the mesh addresses (default: ``package://pouring_robot_description/meshes``).

    Raises:
        DescriptionError: the dimensions file or a xacro file is wrong; names file and, where known, line
            and key.
        UnknownLayoutError: the dimensions file holds no such layout.
        ValueError: ``chain_order`` is not an order of 1, 2, 3, 4.
    """
    if sorted(chain_order) != list(CHAINS):
        raise ValueError(f"chain_order must hold 1, 2, 3 and 4 once each, not {tuple(chain_order)}")
    path = (layouts_file or shipped_layouts_file()).absolute()
    dimensions = read_text(path)
    check_layout(layout, path, dimensions)
    folder = description_folder() / "urdf"
    arguments = {
        "layout": layout,
        "chains": " ".join(str(chain) for chain in chain_order),
        "mesh_prefix": MESH_PACKAGE if mesh_folder is None else mesh_folder.absolute().as_posix(),
    }
    parts = [f"{key}={value}" for key, value in arguments.items()]
    parts += [importlib.metadata.version("xacro"), *(read_text(file) for file in sorted(folder.glob("*.xacro")))]
    arguments["layouts_file"] = str(path)  # its text counts, not its place
    return _rendered(content_key([dimensions, *parts]), dimensions, folder, tuple(arguments.items()))


@functools.lru_cache(maxsize=64)
def _rendered(key: str, dimensions: str, folder: Path, arguments: tuple[tuple[str, str], ...]) -> str:
    """Return the rendering that the key stands for: an earlier process may have made it."""

    def render() -> str:
        from pouring_robot.robot.description.rendering import run_xacro

        path = Path(dict(arguments)["layouts_file"])
        urdf = run_xacro(folder / "pouring_robot.urdf.xacro", dict(arguments), [path])
        if read_text(path) != dimensions:  # xacro read it by itself: do not keep its answer under the other's name
            raise DescriptionError(path, "changed while it was read; run the command again")
        return urdf

    return kept_text(f"urdf/{key}.urdf", render)
