"""Tests run their linear algebra on one thread, as commands do; the processes that run them inherit it."""

from pouring_robot.io.threads import one_blas_thread_from_the_start

one_blas_thread_from_the_start()
