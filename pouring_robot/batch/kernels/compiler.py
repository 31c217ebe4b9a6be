"""How the kernels are compiled: once per machine, and again when the source of any kernel changes.

Only the outermost kernels are kept on disk: each contains all that it calls. Numba by default keeps a kernel next to
its source file, renews it when that file changes, and ignores changes of files whose functions it calls. Here it is
kept in the package's cache folder under a hash of all kernel sources, so that every checkout and environment with the
same sources shares it.
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
    """Determines where a kernel is kept and when it is stale; neither depends on where the package is installed."""

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
    """Numba's own cache, which also tolerates a folder that cannot be read or written, and damaged files in it."""

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
    """Compile a function that other kernels call; it is inlined into them."""
    return cast("Function", numba.njit(**_INNER_OPTIONS)(function))


def outermost(function: Function) -> Function:
    """Compile a kernel that Python calls, and keep it on disk where there is a writable place."""
    kernel = numba.njit(**_OPTIONS)(function)
    with suppress(RuntimeError):  # no place: compiled anew in each process, same numbers
        kernel._cache = _Cache(function)
    return cast("Function", kernel)
