"""The format of printed figures."""

import re
from pathlib import Path

import pouring_robot

_SIGNED = re.compile(r"\{[^{}\"']+:\+(?!z)[^{}]*(?:\{\w+\})?[f%]\}")


def test_no_figure_that_may_be_negative_is_minus_zero():
    """Whoever asks for a sign expects both; such a format makes -0 a 0."""
    sources = Path(pouring_robot.__file__).parent.rglob("*.py")
    assert [str(path) for path in sources if _SIGNED.search(path.read_text(encoding="utf-8"))] == []
