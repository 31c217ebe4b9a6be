"""Threads of the linear algebra: one inside, as many as before outside, however calls are nested."""

import os
import subprocess
import sys

import numpy as np
import scipy.linalg
from threadpoolctl import threadpool_info, threadpool_limits

from pouring_robot.io.threads import one_blas_thread


def blas_threads():
    np.linalg.inv(np.eye(2)), scipy.linalg.inv(np.eye(2))
    return {pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"}


def test_one_inside_and_as_before_outside():
    @one_blas_thread()
    def inner():
        return blas_threads()

    with threadpool_limits(2, user_api="blas"):
        before = blas_threads()
        with one_blas_thread():
            assert blas_threads() == {1}
            assert inner() == {1}
            assert blas_threads() == {1}  # the inner one puts nothing back
        assert inner() == {1}  # a decorated function may be called again and again
        assert blas_threads() == before


def test_what_fails_puts_the_threads_back():
    with threadpool_limits(2, user_api="blas"):
        before = blas_threads()
        try:
            with one_blas_thread():
                raise KeyError
        except KeyError:
            assert blas_threads() == before


def test_a_command_runs_its_linear_algebra_on_one_thread():
    code = (
        "from pouring_robot.cli.app import main\n"
        "assert main(['robots', '--json']) == 0\n"
        "import numpy, scipy.linalg, threadpoolctl\n"
        "print({pool['num_threads'] for pool in threadpoolctl.threadpool_info() if pool['user_api'] == 'blas'})\n"
    )
    environment = {name: value for name, value in os.environ.items() if not name.endswith("_NUM_THREADS")}
    run = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True)
    assert run.stdout.splitlines()[-1] == "{1}"
