"""Parts of the site besides the pages of ``docs/``: changes, API, formulas as MathML; links to outside become names.

A hook of MkDocs, named in ``mkdocs.yml``; the package itself is read, not imported.
"""

from __future__ import annotations

import ast
import html
import re
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]


def exported() -> list[str]:
    """Return the dotted names of everything that ``pouring_robot`` exports, as they are defined."""
    tree = ast.parse((ROOT / "pouring_robot" / "__init__.pyi").read_text(encoding="utf-8"))
    imports = [node for node in tree.body if isinstance(node, ast.ImportFrom)]
    return sorted(f"pouring_robot.{node.module}.{alias.name}" for node in imports for alias in node.names)


def on_files(files: Any, config: Any) -> Any:
    """Add the pages that are not in ``docs/``."""
    from mkdocs.structure.files import File

    api = ["# API", "", "What `pouring_robot` exports; lengths in m, angles in rad.", ""]
    api += [f"::: {name}\n" for name in exported()]
    changes = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8").replace("](docs/", "](")
    for name, content in (("api.md", "\n".join(api)), ("changelog.md", changes)):
        files.append(File.generated(config, name, content=content))
    return files


def on_page_markdown(markdown: str, page: Any, config: Any, files: Any) -> str:
    """Turn links to files that are not on the site into their words and names."""

    def named(found: re.Match[str]) -> str:
        words, target = found[1], found[2].partition("#")[0]
        place = (Path(config.docs_dir) / page.file.src_uri).parent / target
        inside = place.resolve().is_relative_to(Path(config.docs_dir)) and not target.endswith(".ipynb")
        if "://" in target or not target or inside:
            return found[0]
        return f"{words} (`{place.resolve().relative_to(ROOT)}`)"

    return re.sub(r"(?<!!)\[([^\]]+)\]\(([^)\s]+)\)", named, markdown)


def on_page_content(content: str, page: Any, config: Any, files: Any) -> str:
    """Set formulas as MathML, which browsers draw without a script."""
    from latex2mathml.converter import convert

    def formula(found: re.Match[str]) -> str:
        text = html.unescape(found[2]).strip()
        return str(convert(text[2:-2], display="block" if found[1] == "div" else "inline"))

    return re.sub(r'<(div|span) class="arithmatex">(.*?)</\1>', formula, content, flags=re.DOTALL)
