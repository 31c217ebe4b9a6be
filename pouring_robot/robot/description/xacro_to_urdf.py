"""Runs xacro in this process, and finds the file at fault when it fails."""

import html
import os
import re
import threading
import xml.parsers.expat
from collections.abc import Iterable, Mapping
from pathlib import Path

import xacro

from pouring_robot.exceptions import DescriptionError
from pouring_robot.io.files import read_text
from pouring_robot.robot.description.untrusted import confined

# Beginnings of xacro's messages about wrong calls of a macro.
_CALLERS_FAULTS = ("Invalid parameter", "Undefined parameters", "Not enough blocks", "Unused block")

# xacro keeps its file stack, arguments and include list in module globals.
_lock = threading.Lock()


def run_xacro(path: Path, arguments: Mapping[str, str], also: Iterable[Path] = ()) -> str:
    """Return xacro's output for a file, possibly untrusted (see ``untrusted.py``), with its mappings; thread-safe.

    Raises DescriptionError, which names the file at fault, where the file or one it includes is wrong.
    """
    read_text(path)  # xacro would report a missing file twice
    with _lock, confined(path.parent, also):
        try:
            document = xacro.process_file(str(path), mappings=dict(arguments), verbosity=0)
        except xml.parsers.expat.ExpatError as error:
            raise DescriptionError(_file_at_fault(path, ""), f"not valid XML: {error}") from error
        except Exception as error:  # xacro evaluates expressions, so a broken file can raise anything
            cause: BaseException | None = error
            while cause is not None and not isinstance(cause, DescriptionError):
                cause = cause.__cause__ or cause.__context__
            if cause is not None:  # our own error, which xacro may have wrapped
                raise cause from None
            problem = f"xacro: {error or type(error).__name__}"
            if asked := re.search(r"Undefined substitution argument (\w+)", problem):
                name = asked[1]
                problem += (
                    f"; give it in the robot file, as mappings: {{{name}: …}}, or to robot init as --mapping {name}=…"
                )
            raise DescriptionError(_file_at_fault(path, str(error)), problem) from error
        # The banner contains a path of this machine; the same description must give the same text anywhere.
        for node in list(document.childNodes):
            if node.nodeType == node.COMMENT_NODE:
                document.removeChild(node)
        return re.sub(r"\n\s*\n", "\n", document.toprettyxml(indent="  "))


def _file_at_fault(path: Path, problem: str) -> Path:
    """Return the file at which xacro failed: on failure it leaves its stacks as they were.

    The macro on top is not always at fault: xacro enters it before it evaluates the caller's arguments, and evaluates
    properties where they are used. So the file must contain the text that the error message quotes.
    """
    stacks = [xacro.filestack, *(macro.history[-1] for macro in xacro.macrostack or [])]
    entered = [Path(os.path.normpath(stack[-1])) for stack in stacks if stack and stack[-1]] or [path]
    quoted = re.search(
        r"evaluating expression '(.*?)'(?:\s+when evaluating |\s*$)|unknown macro name: (\S+)", problem, re.DOTALL
    )
    if quoted:
        wanted = _plain(f"${{{quoted[1]}}}" if quoted[1] is not None else f"<{quoted[2]}")
        for file in (*reversed(entered), *sorted(path.parent.glob("*.xacro"))):
            if wanted in _plain(html.unescape(read_text(file))):
                return file
    if len(entered) > 1 and problem.startswith(_CALLERS_FAULTS):
        return entered[-2]
    return entered[-1]


def _plain(text: str) -> str:
    return "".join(text.split())
