"""Shared by the tests of the command line."""

import pytest

from pouring_robot.cli.app import main


@pytest.fixture
def run(capfd, tmp_path, monkeypatch):
    """Run a command in an empty folder; return exit code, standard output and standard error."""
    monkeypatch.chdir(tmp_path)

    def call(*arguments):
        code = main([str(argument) for argument in arguments])
        printed = capfd.readouterr()
        return code, printed.out, printed.err

    return call
