"""How much an installation weighs, package by package: of the environment that runs this, without pip's own.

    python -m venv fresh && fresh/bin/pip install . && fresh/bin/python scripts/benchmarks/installed_size.py

Sizes are those of the files that each distribution brought, pip's copies of links and compiled Python among them.
"""

from __future__ import annotations

import importlib.metadata
from pathlib import Path

SHOWN, OF_VENV = 15, {"pip", "setuptools"}


def sizes() -> dict[str, tuple[int, int]]:
    """Return bytes of each distribution by its name, and how many of these are headers for C++."""
    found = {}
    for distribution in importlib.metadata.distributions():
        files = [Path(str(distribution.locate_file(file))) for file in distribution.files or ()]
        there = {path: path.lstat().st_size for path in files if path.is_file()}
        headers = sum(size for path, size in there.items() if "include" in path.parts)
        found[distribution.metadata["Name"]] = sum(there.values()), headers
    return {name: size for name, size in found.items() if name not in OF_VENV}


def main() -> None:
    """Print the largest and the sum."""
    found = sorted(sizes().items(), key=lambda item: -item[1][0])
    print("| package | MB | of them C++ headers |\n|---|---|---|")
    for name, (size, headers) in found[:SHOWN]:
        print(f"| {name} | {size / 1e6:.0f} | {headers / 1e6:.0f} |")
    rest = sum(size for _, (size, _) in found[SHOWN:])
    print(f"| {len(found) - SHOWN} others | {rest / 1e6:.0f} | |")
    total, headers = (sum(size[k] for _, size in found) for k in (0, 1))
    print(f"| all {len(found)} | {total / 1e6:.0f} | {headers / 1e6:.0f} |")


if __name__ == "__main__":
    main()
