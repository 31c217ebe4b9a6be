"""One thing said of the disagreement, as a record, a sentence and an entry of ``diagnosis.json``."""

from dataclasses import dataclass

from pouring_robot.mechanism.poses import MM, MRAD

LACK_OF_FIT, REPEATS, COMPONENT, CONDITION, REGION = "lack of fit", "repeats", "component", "condition", "region"


@dataclass(frozen=True)
class Finding:
    """One thing said of the disagreement.

    Attributes:
        what: ``lack of fit``, ``repeats``, ``component``, ``condition`` or ``region``.
        sentence: in words.
        size: root mean square, or the span of what a condition does, in m or rad.
        p_value: probability that noise alone makes as much anywhere; None where the noise is not known.
        component: in which component it is largest; "" for all together.
        turning: whether it counts in rad.
        condition: condition or region; "" for none.
        rivals: conditions that went along and would explain it as well.
        share: of the sum of squares, what this condition explains beside those before it.
    """

    what: str
    sentence: str
    size: float
    p_value: float | None
    component: str = ""
    turning: bool = False
    condition: str = ""
    rivals: tuple[str, ...] = ()
    share: float = 1.0

    def as_json(self) -> dict[str, object]:
        """Return it as ``diagnosis.json`` holds it."""
        size = {"size_mrad": self.size / MRAD} if self.turning else {"size_mm": self.size / MM}
        out = {"what": self.what, "component": self.component, "condition": self.condition, **size}
        out |= {"p_value": self.p_value, "sentence": self.sentence}
        return out | ({"or": list(self.rivals)} if self.rivals else {})


def size_text(size: float, turning: bool = False) -> str:
    """Return a size in m or rad as mm or mrad, two figures."""
    value = size / (MRAD if turning else MM)
    digits = 3 if abs(value) < 0.1 else 2 if abs(value) < 1.0 else 1
    return f"{value:.{digits}f} {'mrad' if turning else 'mm'}"
