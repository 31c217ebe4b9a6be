"""A claim of the paper, our figures, and the verdict that follows from them by a stated rule."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

Verdict = Literal["reproduced", "differs", "cannot be checked"]


@dataclass(frozen=True)
class Claim:
    """One row: a statement of the paper against our figures.

    Attributes:
        key: short name for files and tests.
        source: section of the paper.
        says: the statement, shortened.
        computed: our figures as a sentence.
        verdict: whether they agree.
        rule: what decides, stated without the outcome.
        why: the reason for the outcome, in one line.
        reading: how the statement is understood, where its words leave it open.
        used: whether the layout or the DH convention was inferred from this statement, so that agreement tests little.
        figures: the figures for JSON.
    """

    key: str
    source: str
    says: str
    computed: str
    verdict: Verdict
    rule: str
    why: str
    reading: str = "as printed"
    used: bool = False
    figures: dict[str, Any] = field(default_factory=dict)

    @property
    def reasons(self) -> str:
        """Reading, rule and reason, one line each."""
        said = {"read": self.reading, "agrees if": self.rule, "why": self.why}
        return "\n".join(f"{word}: {text}" for word, text in said.items() if text)


def judge(agrees: bool | np.bool_) -> Verdict:
    """Return the verdict for a comparison that could be made."""
    return "reproduced" if agrees else "differs"


COLUMNS = ("key", "source", "says", "reading", "computed", "verdict", "rule", "why")
"""Of a claim's row in files."""


def listed(names: Iterable[str]) -> str:
    """Return names for a sentence."""
    return " ".join(names) or "none"
