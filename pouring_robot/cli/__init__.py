"""The command line: one file a subcommand; ``app`` puts them together and turns errors into one line."""

from __future__ import annotations

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
