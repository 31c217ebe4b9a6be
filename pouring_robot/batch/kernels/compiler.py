"""How the kernels are compiled, and kept on disk.

Only the outermost kernels are kept: each holds all it calls. Numba renews a kept kernel when its own file changes,
but not when a file changes that it calls into. So the outermost kernels close over a stamp of all kernel sources,
which is part of the key they are kept under.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

import numba

# No Python object and no memory management inside kernels (_nrt): they get all arrays from outside. 'contract' lets
# the compiler fuse a*b + c; NaN and infinity keep their meaning.
_OPTIONS: dict[str, Any] = {"nogil": True, "error_model": "numpy", "fastmath": {"contract"}, "_nrt": False}

_INNER_OPTIONS = _OPTIONS | {"forceinline": True, "no_cpython_wrapper": True, "no_cfunc_wrapper": True}

Function = TypeVar("Function", bound=Callable[..., Any])


def compiled(function: Function) -> Function:
    """Compile a function that other kernels call; it becomes part of them."""
    return cast("Function", numba.njit(**_INNER_OPTIONS)(function))


def outermost(function: Function) -> Function:
    """Compile a kernel that Python calls, and keep it on disk where there is a place that may be written."""
    try:
        return cast("Function", numba.njit(cache=True, **_OPTIONS)(function))
    except RuntimeError:  # a read-only installation without a home: compiled anew in each process, same numbers
        return cast("Function", numba.njit(**_OPTIONS)(function))


def _stamp() -> int:
    digest = hashlib.sha256()
    for path in [*sorted(Path(__file__).parent.glob("*.py")), Path(__file__).parents[1] / "structure.py"]:
        digest.update(path.read_bytes())
    return int.from_bytes(digest.digest()[:7], "big")


SOURCE_STAMP = _stamp()
