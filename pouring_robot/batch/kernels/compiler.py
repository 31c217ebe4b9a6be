"""How the kernels are compiled: once a machine, and again when a kernel's source changes.

Only the outermost kernels are kept on disk: each holds all it calls. By itself Numba keeps a kernel beside its source
file, renews it when that file changes, and does not look at files it calls into. Here it is kept in the cache folder of
the package under a stamp of all kernel sources, so that every checkout and environment with the same sources shares it.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, TypeVar, cast

import numba
from numba.core.caching import CompileResultCacheImpl, FunctionCache, _CacheLocator

from pouring_robot.io.cache import cache_folder, content_key
from pouring_robot.mechanism.closure import null_space

# No Python object and no memory management inside kernels (_nrt): they get all arrays from outside. 'contract' lets
# the compiler fuse a*b + c; NaN and infinity keep their meaning.
_OPTIONS: dict[str, Any] = {"nogil": True, "error_model": "numpy", "fastmath": {"contract"}, "_nrt": False}

_INNER_OPTIONS = _OPTIONS | {"forceinline": True, "no_cpython_wrapper": True, "no_cfunc_wrapper": True}

Function = TypeVar("Function", bound=Callable[..., Any])


class _Locator(_CacheLocator):  # type: ignore[misc]
    """Says where a kernel is kept, and what makes it stale; neither depends on where the package is installed."""

    def __init__(self, folder: Path, function: Callable[..., Any]) -> None:
        # The text of the kernel's file and of all here, of what they import, and the compiler.
        here, closure = Path(__file__).parent, Path(null_space.__file__).parent
        beside = (here.parent / "structure.py", closure / "status.py", closure / "null_space.py")
        files = [*sorted(here.glob("*.py")), *beside, Path(function.__code__.co_filename)]
        self._stamp = content_key([numba.__version__, repr(_OPTIONS), *(path.read_bytes() for path in files)])
        self._path = str(folder / "kernels" / self._stamp)

    def get_cache_path(self) -> str:
        return self._path

    def get_source_stamp(self) -> str:
        return self._stamp

    def get_disambiguator(self) -> str:
        return "kernel"

    @classmethod
    def from_function(cls, py_func: Any, py_file: str) -> _Locator | None:
        del py_file
        folder = cache_folder()
        return None if folder is None else cls(folder, py_func)


class _Impl(CompileResultCacheImpl):  # type: ignore[misc]
    _locator_classes = (_Locator,)


class _Cache(FunctionCache):  # type: ignore[misc]
    """Numba's own, which also lives with a folder that cannot be read or written, and with a damaged file in it."""

    _impl_class = _Impl

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        try:
            return super().load_overload(sig, target_context)
        except Exception:  # a damaged file may raise anything: forget what is kept, compile anew, same numbers
            with suppress(OSError):
                self.flush()
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        with suppress(OSError):
            super().save_overload(sig, data)


def compiled(function: Function) -> Function:
    """Compile a function that other kernels call; it becomes part of them."""
    return cast("Function", numba.njit(**_INNER_OPTIONS)(function))


def outermost(function: Function) -> Function:
    """Compile a kernel that Python calls, and keep it on disk where there is a place that may be written."""
    kernel = numba.njit(**_OPTIONS)(function)
    with suppress(RuntimeError):  # no place: compiled anew in each process, same numbers
        kernel._cache = _Cache(function)
    return cast("Function", kernel)
