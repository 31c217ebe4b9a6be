"""The only place that decides how many threads linear algebra uses: one.

The package's matrices have tens to hundreds of rows. Threads of the BLAS that share such a product wait for each other
far longer than they work: a calibration of one second takes four on two busy cores, with the same result to the last
bit. Work is shared by samples (:mod:`pouring_robot.batch`) or by processes instead.
"""

import functools
import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

_VARIABLES = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "BLIS_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")


class _Shared:
    """How many callers need one thread now, and the limits to restore when the last of them is done."""

    lock = threading.Lock()
    callers = 0
    before: Any = None


@functools.cache
def _libraries() -> Any:
    """Return the controller of the BLAS of NumPy and of SciPy; found once, as the search takes long."""
    import scipy.linalg  # noqa: F401  (its BLAS is not NumPy's; one that is not loaded is not limited)
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Limit linear algebra to one thread inside a ``with`` block or a decorated function; may be nested."""
    with _Shared.lock:
        _Shared.callers += 1
        if _Shared.callers == 1:
            _Shared.before = _libraries().limit(limits=1, user_api="blas")
    try:
        yield
    finally:
        with _Shared.lock:
            _Shared.callers -= 1
            if _Shared.callers == 0:
                _Shared.before.restore_original_limits()


def one_blas_thread_from_the_start() -> None:
    """Limit this process and its children to one thread, unless the user chose otherwise; call before importing NumPy.

    Inside :func:`one_blas_thread` it is one thread in any case.
    """
    for name in _VARIABLES:
        os.environ.setdefault(name, "1")
