"""Size of an installation by the dependency that requires it: of the environment that runs this, without pip itself.

    python -m venv fresh && fresh/bin/pip install . && fresh/bin/python scripts/benchmarks/installed_size.py

Sizes are those of the files that each distribution installed, including pip's copies of links and compiled Python. A
distribution counts for the first group that requires it, directly or indirectly.
"""

from __future__ import annotations

import importlib.metadata
import re
from pathlib import Path

GROUPS = (
    ("numpy", "scipy"),
    ("pin",),
    ("numba",),
    ("pandas", "xarray", "zarr"),
    ("matplotlib", "pillow"),
    ("meshcat",),
)
SHOWN, OF_VENV = 4, {"pip", "setuptools"}


def canonical(name: str) -> str:
    """Return a distribution's name as indexes spell it."""
    return re.sub(r"[-_.]+", "-", name).lower()


def sizes() -> dict[str, tuple[int, int]]:
    """Return bytes of each distribution by its name, and how many of these are headers for C++."""
    found = {}
    for distribution in importlib.metadata.distributions():
        files = [Path(str(distribution.locate_file(file))) for file in distribution.files or ()]
        there = {path: path.lstat().st_size for path in files if path.is_file()}
        headers = sum(size for path, size in there.items() if "include" in path.parts)
        found[canonical(distribution.metadata["Name"])] = sum(there.values()), headers
    return {name: size for name, size in found.items() if name not in OF_VENV}


def asked_for(name: str, taken: set[str]) -> set[str]:
    """Return a distribution with all it asks for without extras, but for those that are taken."""
    if name in taken:
        return set()
    found = {name}
    for line in importlib.metadata.requires(name) or ():
        if "extra ==" not in line:
            found |= asked_for(canonical(re.split(r"[^\w.-]", line)[0]), taken | found)
    return found


def main() -> None:
    """Print the groups and the sum."""
    found = sizes()
    missing, rows = OF_VENV | _absent(found), []
    taken = set(missing)
    for group in GROUPS:
        members: set[str] = set()
        for name in group:
            members |= asked_for(name, taken | members)
        taken |= members
        rows.append((" and ".join(group), members))
    rows.append(("others", set(found) - taken))
    print("| for | packages | MB | of them C++ headers | largest |\n|---|---|---|---|---|")
    for what, members in [*rows, ("all", set(found))]:
        size, headers = (sum(found[name][k] for name in members) for k in (0, 1))
        largest = sorted(members, key=lambda name: -found[name][0])[:SHOWN]
        words = ", ".join(f"{name} {found[name][0] / 1e6:.0f}" for name in largest)
        print(f"| {what} | {len(members)} | {size / 1e6:.0f} | {headers / 1e6:.0f} | {words} |")


def _absent(found: dict[str, tuple[int, int]]) -> set[str]:
    """Return what is asked for but not installed: for other systems."""
    named = {
        canonical(re.split(r"[^\w.-]", line)[0]) for name in found for line in importlib.metadata.requires(name) or ()
    }
    return named - set(found)


if __name__ == "__main__":
    main()
