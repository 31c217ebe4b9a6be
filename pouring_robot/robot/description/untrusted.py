"""What an untrusted robot description may do: it runs no code, and reads no files outside its surroundings.

xacro evaluates Python expressions. Its own guard checks only the outermost node, and ``$(eval …)`` gives access to all
of Python; both would run untrusted code. So every node of an expression is checked before it is evaluated, and
``$(eval …)`` and the environment are refused. Files are read only below the folder above the description, and below
those that the environment variable :data:`FOLDERS_VARIABLE` names; ROS packages are searched there. The time that an
expression takes is not limited.
"""

import ast
import contextlib
import functools
import os
import re
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import IO, Any, NoReturn

from pouring_robot.exceptions import DescriptionError

FOLDERS_VARIABLE = "POURING_ROBOT_DESCRIPTIONS"
"""Environment variable with further folders that descriptions may read, separated as in ``PATH``."""
_LONGEST = 10_000  # characters of an expression
_REFUSED = {
    "_eval": "$(eval …): write ${…}",
    "_env": "$(env …): pass it as a mapping",
    "_optenv": "$(optenv …): pass it as a mapping",
}
_INTROSPECTION = re.compile(
    r"_|(gi|cr|ag)_(frame|code|yieldfrom|await|origin)$|f_(back|globals|locals|builtins|code)$|tb_(frame|next)$"
    r"|(mro|format|format_map|type|vars)$"
)


def readable(path: Path | str, folder: Path, also: Iterable[Path] = ()) -> Path:
    """Return a path, absolute or in a description's folder, if the description may read it, or raise DescriptionError.

    It may read everything below the folder above its own, and the files ``also`` wherever they are.
    """
    target = Path(os.path.realpath(folder / path))
    if any(target.is_relative_to(place.resolve()) for place in (*_folders(folder), *also)):
        return target
    problem = f"lies outside the folder above {folder}, where descriptions may not read; put it beside the others"
    raise DescriptionError(path, f"{problem}, or name its folder in {FOLDERS_VARIABLE}")


def _folders(folder: Path) -> list[Path]:
    """Return the folders that a description in a folder may read: the one above it, and those in the variable."""
    own = Path(os.path.realpath(folder))
    # A folder directly below the root does not give access to the whole disk.
    above = own if own.parent == Path(own.anchor) else own.parent
    named = filter(None, os.environ.get(FOLDERS_VARIABLE, "").split(os.pathsep))
    return [above, *(Path(place).resolve() for place in named)]


def package(name: str, folder: Path) -> Path:
    """Return the folder of a ROS package: the one above a description's folder, next to it, or among those named.

    A clone is often called otherwise than its package: what stands in its ``package.xml`` counts as well. Raises
    DescriptionError where there is no package of that name.
    """
    for place in _folders(folder):
        for found in (place, place / name):
            if found.name == name != ".." and found.is_dir():
                return found.resolve()
        for manifest in (place / "package.xml", *sorted(place.glob("*/package.xml"))):
            with contextlib.suppress(OSError):  # of a neighbour that nobody may read
                if re.search(rf"<name>\s*{re.escape(name)}\s*</name>", manifest.read_text("utf-8", "replace")):
                    return manifest.parent.resolve()
    problem = f"the package '{name}' is not found; name the folder that holds it in {FOLDERS_VARIABLE}"
    raise DescriptionError(folder, problem)


@contextlib.contextmanager
def confined(folder: Path, also: Iterable[Path] = ()) -> Iterator[None]:
    """Prevent xacro, which uses module globals, from running code and reading elsewhere, while the context lasts."""
    from unittest import mock  # slow to import, as is the next, and used only here

    import xacro.substitution_args

    evaluate: Callable[..., Any] = xacro.safe_eval

    def careful(expression: str, *names: Any) -> Any:
        _check(expression)
        return evaluate(expression, *names)

    def opened(path: str) -> IO[str]:
        if absent := re.search("package://([^/]+)", path):
            package(absent[1], folder)
        return readable(Path.cwd() / path, folder, also).open(encoding="utf-8")

    def found(name: str) -> str:
        with contextlib.suppress(DescriptionError):  # raised again where a file of the package is read
            return str(package(name, folder))
        return f"package://{name}"

    with contextlib.ExitStack() as stack:
        for module, name, stand_in in (
            (xacro, "safe_eval", careful),
            (xacro, "open", opened),
            (xacro.substitution_args, "_eval_find", found),
            *((xacro.substitution_args, name, functools.partial(_refuse, said)) for name, said in _REFUSED.items()),
        ):
            stack.enter_context(mock.patch.object(module, name, stand_in, create=True))
        yield


def _refuse(said: str, *_: Any, **__: Any) -> NoReturn:
    raise ValueError(f"descriptions may not use {said}")


@functools.lru_cache(maxsize=1000)  # each leg of a robot has the same expressions
def _check(expression: str) -> None:
    """Raise ValueError for an expression that could access more than numbers, words and lists."""
    if len(expression) > _LONGEST:
        raise ValueError("an expression is too long")
    for node in ast.walk(ast.parse(expression.strip(), mode="eval")):
        name = node.attr if isinstance(node, ast.Attribute) else ""
        if _INTROSPECTION.match(name) or (isinstance(node, ast.Name) and (name := node.id).startswith("__")):
            raise ValueError(f"descriptions may not use '{name}'")
