"""The command line: ``pouring-robot``."""

from __future__ import annotations

from pouring_robot.cli.app import main

__all__ = ["main"]
