"""``python examples/telescope_focus/diagnose.py DIR``: the same as ``python -m examples.telescope_focus DIR``."""

import importlib
import importlib.util
import sys
from pathlib import Path

if __name__ == "__main__":
    here = Path(__file__).resolve()
    sys.path[0] = str(here.parents[1])  # not this folder, whose modules belong to a package
    if importlib.util.find_spec("pouring_robot") is None:  # a checkout that is not installed
        sys.path.append(str(here.parents[2]))
    sys.exit(importlib.import_module("telescope_focus.command").main())
