"""A claim of the paper beside our figures, and the verdict that follows from them by a stated rule."""

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
        why: the rule, and the reason for the outcome.
        used: whether the layout or the DH convention was inferred from this statement, so that agreement tests little.
        figures: the figures for JSON.
    """

    key: str
    source: str
    says: str
    computed: str
    verdict: Verdict
    why: str
    used: bool = False
    figures: dict[str, Any] = field(default_factory=dict)


def judge(agrees: bool | np.bool_) -> Verdict:
    """Return the verdict for a comparison that could be made."""
    return "reproduced" if agrees else "differs"


def listed(names: Iterable[str]) -> str:
    """Return names for a sentence."""
    return " ".join(names) or "none"
