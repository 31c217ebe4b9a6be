"""One thing said of the disagreement, as a record, a sentence and an entry of ``diagnosis.json``."""

from dataclasses import dataclass

from pouring_robot.mechanism.poses import MM, MRAD

LACK_OF_FIT, REPEATS, COMPONENT, CONDITION, REGION = "lack of fit", "repeats", "component", "condition", "region"


@dataclass(frozen=True)
class Finding:
    """One thing said of the disagreement."""

    what: str  # ``lack of fit``, ``repeats``, ``component``, ``condition`` or ``region``
    sentence: str  # in words
    size: float  # root mean square, or the span of what a condition does, in m or rad
    p_value: float | None  # probability that noise alone makes as much anywhere; None where the noise is not known
    component: str = ""  # in which component it is largest; "" for all together
    turning: bool = False  # whether it counts in rad
    condition: str = ""  # condition or region; "" for none
    rivals: tuple[str, ...] = ()  # conditions that went along and would explain it as well
    share: float = 1.0  # of the sum of squares, what this condition explains beside those before it

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
