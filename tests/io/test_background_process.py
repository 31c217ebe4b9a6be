"""Work in forked processes: its result, its errors, and no fork that outlives its parent process."""

import signal
import subprocess
import sys
import textwrap
import time
from pathlib import Path

import pytest

pytestmark = pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="copies are made on Linux only")

START = """
    import os, sys, threading, time
    from pouring_robot.exceptions import OutputError
    from pouring_robot.io.background_process import forked
"""


def run(code):
    whole = textwrap.dedent(START) + textwrap.dedent(code)
    return subprocess.run([sys.executable, "-c", whole], capture_output=True, text=True, timeout=60, check=False)


def test_a_copy_works_while_this_process_goes_on():
    done = run(
        """
        with forked(lambda: (os.getpid(), "x" * 10**6)) as found:
            pid, text = found()
        print(pid != os.getpid(), len(text))
        """
    )
    assert done.stdout == "True 1000000\n", done.stderr


def test_beside_another_thread_the_work_is_done_here():
    done = run(
        """
        stop = threading.Event()
        threading.Thread(target=stop.wait).start()
        with forked(os.getpid) as found:
            print(found() == os.getpid())
        stop.set()
        """
    )
    assert done.stdout == "True\n", done.stderr


def test_what_fails_in_a_copy_is_done_here_again_and_says_why():
    done = run(
        """
        def draw():
            raise OutputError("folder/file", str(os.getpid()))

        try:
            with forked(draw) as found:
                found()
        except OutputError as error:
            print(error.problem == str(os.getpid()))
        """
    )
    assert (done.stdout, done.stderr) == ("True\n", "")


def test_what_a_copy_ends_without_is_done_here():
    done = run(
        """
        here = os.getpid()
        with forked(lambda: os.getpid() if os.getpid() == here else os._exit(3)) as found:
            print(found() == here)
        """
    )
    assert done.stdout == "True\n", done.stderr


@pytest.mark.parametrize("how", [signal.SIGTERM, signal.SIGKILL, signal.SIGINT])
def test_a_copy_ends_with_its_process(how):
    # Whoever starts the tests in the background has them ignore a Ctrl-C, and what they start inherits that.
    code = """
        import signal
        signal.signal(signal.SIGINT, signal.default_int_handler)
        with forked(lambda: print(os.getpid(), flush=True) or time.sleep(300)) as found:
            found()
    """
    whole = textwrap.dedent(START) + textwrap.dedent(code)
    with subprocess.Popen([sys.executable, "-c", whole], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL) as process:
        copy = int(process.stdout.readline())
        process.send_signal(how)
        process.wait(timeout=60)
    until = time.monotonic() + 60.0
    while alive(copy) and time.monotonic() < until:
        time.sleep(0.02)
    assert not alive(copy)


def alive(pid):
    try:
        state = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()[0]
    except FileNotFoundError:
        return False
    return state != "Z"  # dead, and not yet asked for by whoever inherited it
