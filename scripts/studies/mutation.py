"""Break the closure, G, the evidence and the verdict, one small change at a time, and count how often tests notice.

    python -m scripts.studies.mutation --sample 60 --seed 1

Needs cosmic-ray (``pip install cosmic-ray``), which makes the changes; they are drawn at random from all its mutations.
Works on a copy of the checkout. Changes of annotations have no effect and do not count. Prints a Markdown table and the
changes that no test noticed.
"""

from __future__ import annotations

import argparse
import ast
import difflib
import itertools
import os
import random
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]


@dataclass(frozen=True)
class Target:
    """What is broken, and the tests that should notice, quick ones first."""

    module: str
    tests: tuple[str, ...]


TARGETS = {
    "closure": Target(
        "pouring_robot/mechanism/closure/solver.py",
        tuple(f"tests/mechanism/test_{room}.py" for room in ("closure_figures", "newton", "growth", "idle", "serial")),
    ),
    "G": Target(
        "pouring_robot/mechanism/transfer.py",
        (
            "tests/mechanism/test_idle.py",
            "tests/mechanism/test_transfer.py::test_frames_move_the_pose_as_a_rigid_body",
            "tests/mechanism/test_transfer.py::test_parameters_that_do_not_apply_are_refused",
            "tests/mechanism/test_transfer.py::test_payload_and_stiffness_match_central_differences",
            "tests/mechanism/test_serial.py",
        ),
    ),
    "evidence": Target("pouring_robot/inference/evidence.py", ("tests/inference/test_evidence.py", "tests/inference")),
    "verdict": Target("pouring_robot/inference/decision.py", ("tests/inference/test_decision.py", "tests/inference")),
}


class _Bare(ast.NodeTransformer):
    """Removes annotations."""

    def visit_arg(self, node: ast.arg) -> ast.arg:
        node.annotation = None
        return node

    def visit_FunctionDef(self, node: ast.FunctionDef) -> ast.AST:
        node.returns = None
        return self.generic_visit(node)

    def visit_AnnAssign(self, node: ast.AnnAssign) -> ast.AST:
        node.annotation = ast.Constant(None)
        return self.generic_visit(node)


def bare(code: str) -> str:
    """Return what code does, without what it says of types; nothing if it is no code."""
    try:
        return ast.dump(_Bare().visit(ast.parse(code)))
    except SyntaxError:
        return ""


def places(source: str) -> list[tuple[str, int]]:
    """Return every change that cosmic-ray can make: what it does, and to which of the places where it can."""
    from cosmic_ray.ast import ast_nodes, get_ast
    from cosmic_ray.plugins import get_operator, operator_names

    tree, found = get_ast(source), []
    for name in sorted(operator_names()):
        kind = get_operator(name)
        if not kind.arguments():
            count = sum(len(list(kind().mutation_positions(node))) for node in ast_nodes(tree))
            found += [(name, number) for number in range(count)]
    return found


def changes(source: str, drawn: list[tuple[str, int]]) -> Iterator[str]:
    """Yield the code after each change that makes other code of it."""
    from cosmic_ray.mutating import mutate_code
    from cosmic_ray.plugins import get_operator

    original = bare(source)
    for name, number in drawn:
        code = str(mutate_code(source, get_operator(name)(), number))
        if bare(code) not in ("", original):
            yield code


def notices(folder: Path, target: Target, patience_s: float) -> bool:
    """Return whether a test of a target fails, or does not end."""
    environment = os.environ | {"PYTHONPATH": str(folder), "PYTHONDONTWRITEBYTECODE": "1"}
    command = [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", *target.tests]
    try:
        run = subprocess.run(command, cwd=folder, env=environment, capture_output=True, timeout=patience_s, check=False)
    except subprocess.TimeoutExpired:
        return True
    return run.returncode != 0


def difference(before: str, after: str) -> str:
    """Return the changed lines in one line of text."""
    lines = difflib.unified_diff(before.splitlines(), after.splitlines(), n=0, lineterm="")
    return "  ".join(line.strip() for line in list(lines)[2:])


def main() -> int:
    """Run the study."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sample", type=int, default=60, help="changes of each module (default 60)")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", action="append", choices=TARGETS)
    given = parser.parse_args()
    survived: list[str] = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "checkout"
        shutil.copytree(ROOT, folder, ignore=shutil.ignore_patterns(".*", "output", "demo", "site"))
        print("| part | module | possible changes | tried | noticed | share |", flush=True)
        print("|---|---|---|---|---|---|", flush=True)
        for part in given.only or TARGETS:
            target = TARGETS[part]
            path = folder / target.module
            original = path.read_text()
            begun = time.perf_counter()
            if notices(folder, target, 1800.0):
                raise SystemExit(f"{part}: its tests fail before anything is changed")
            patience_s = 20.0 + 2.0 * (time.perf_counter() - begun)
            possible = places(original)
            drawn = random.Random(given.seed).sample(possible, len(possible))
            tried = noticed = 0
            for code in itertools.islice(changes(original, drawn), given.sample):
                path.write_text(code)
                tried += 1
                if notices(folder, target, patience_s):
                    noticed += 1
                else:
                    survived.append(f"{part}: {difference(original, code)}")
            path.write_text(original)
            print(
                f"| {part} | `{target.module}` | {len(possible)} | {tried} | {noticed} | {noticed / tried:.0%} |",
                flush=True,
            )
    print("\nNot noticed:\n")
    print("\n".join(f"- `{line}`" for line in survived))
    return 0


if __name__ == "__main__":
    sys.exit(main())
