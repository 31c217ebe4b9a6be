"""The command line: one file a subcommand; ``app`` puts them together and turns errors into one line."""

from __future__ import annotations

from pouring_robot.cli.app import main

__all__ = ["main"]
