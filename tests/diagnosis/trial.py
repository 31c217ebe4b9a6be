"""One blind trial: a campaign with a known truth is diagnosed, and the answer is judged against the truth."""

from __future__ import annotations

import json
import math
import tempfile
import time
import traceback
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from pouring_robot.campaign.data import Campaign as MeasuredCampaign
from pouring_robot.diagnosis.diagnose import Diagnosis, DiagnosisOptions, diagnose
from pouring_robot.exceptions import PouringRobotError
from pouring_robot.inference.problem import WORKMANSHIP_FORM
from pouring_robot.robot.model import RobotModel
from tests.rig import Campaign, write_case

STRONG = 3.0
"""Times the noise from which an effect must be named."""
TEXTBOOK = {
    "drive_zero_offset": ("all", "all_homed"),
    "drive_scale": ("whole_length",),
    "drive_backlash": ("both_sides",),
    "leg_compliance": ("rod",),
    "truss_deflection": ("moving_load",),
    "base_drift": ("steady",),
}
"""Forms of the library whose parameters have the meaning of the rig's textbook form; any form of other effects."""


@dataclass(frozen=True)
class Said:
    """A named effect: as in :class:`~pouring_robot.inference.decision.Cause`."""

    effect: str
    form: str
    alternatives: tuple[str, ...]
    probability: float
    evidence: float
    size: float

    @property
    def choices(self) -> frozenset[str]:
        """The effect and those that cannot be distinguished from it."""
        return frozenset((self.effect, *self.alternatives))


@dataclass(frozen=True)
class Estimate:
    """A parameter with its true value, in its unit."""

    effect: str
    parameter: str
    unit: str
    value: float
    std: float
    truth: float

    @property
    def z(self) -> float:
        """Error in standard deviations."""
        return (self.value - self.truth) / self.std if self.std > 0.0 else math.inf


@dataclass(frozen=True)
class Trial:
    """What was hidden and what the diagnosis reported.

    Attributes:
        name: of the campaign.
        seed: of the campaign, where it is known.
        kind: null, single, pair, outside or confounded.
        hidden: ids of the effects at work.
        forms: their forms in the rig.
        ratios: size of each against the noise.
        accept: ids any of which explains a confounded campaign.
        workmanship: whether the machine also has small errors of its joints.
        excluded: id that was taken out of the library; "" if none.
        rows: of the campaign.
        verdict: "" where there was no diagnosis.
        said: the named effects.
        reasons: why the verdict is what it is.
        gap: held-out ``before``, ``after`` and ``floor`` of the position in mm; NaN where no rows are held out.
        turn_gap: the same for the rotation, in mrad.
        unknown_size: size of the unknown, over the noise; 0 where nothing is unknown or it scatters.
        closed: share of the held-out gap of the position that is closed.
        estimates: parameters whose true value is known.
        seconds: duration of the diagnosis.
        refused: why there was no diagnosis.
    """

    name: str
    seed: tuple[int, ...]
    kind: str
    hidden: tuple[str, ...]
    forms: tuple[str, ...]
    ratios: tuple[float, ...]
    accept: tuple[str, ...]
    workmanship: bool = False
    excluded: str = ""
    rows: int = 0
    verdict: str = ""
    said: tuple[Said, ...] = ()
    reasons: tuple[str, ...] = ()
    gap: tuple[float, float, float] = (math.nan,) * 3
    turn_gap: tuple[float, float, float] = (math.nan,) * 3
    unknown_size: float = math.nan
    closed: float = math.nan
    estimates: tuple[Estimate, ...] = ()
    seconds: float = math.nan
    refused: str = ""

    @property
    def named(self) -> frozenset[str]:
        """Ids of the named effects."""
        return frozenset(said.effect for said in self.said)

    def stands(self, said: Said) -> bool:
        """Whether a named effect is at work; small errors of all joints are where the machine has them."""
        usual = self.workmanship and said.form == WORKMANSHIP_FORM
        return usual or said.effect in {*self.hidden, *self.accept}

    @property
    def exact(self) -> bool:
        """Whether the effects at work are named and no false one is."""
        return self.verdict in {"named", "group"} and self.named == frozenset(self.hidden)

    @property
    def in_group(self) -> bool:
        """Whether the one effect at work is named or among the alternatives, and no false one is named."""
        return (
            self.verdict in {"named", "group"}
            and len(self.said) == len(self.hidden)
            and all(any(truth in said.choices for said in self.said) for truth in self.hidden)
        )

    @property
    def grouped(self) -> bool:
        """Whether the answer is a group that holds a true effect."""
        return self.verdict == "group" and any(set(self.hidden) & said.choices for said in self.said)

    @property
    def acceptable(self) -> bool:
        """Whether what is named, with its alternatives, holds the truth or an effect that explains the data as well."""
        allowed = {*self.hidden, *self.accept}
        return self.verdict in {"named", "group"} and all(allowed & said.choices for said in self.said)

    @property
    def shows(self) -> bool:
        """Whether every effect at work is at least as large as the noise."""
        return min(self.ratios, default=math.inf) >= 1.0

    @property
    def worse(self) -> float:
        """How much larger the held-out gap is with the amended model, as a share; the worse of position and turn."""
        pairs = [(b, a) for b, a, _ in (self.gap, self.turn_gap) if math.isfinite(b) and b > 0.0]
        return max((a / b - 1.0 for b, a in pairs), default=math.nan)

    def line(self) -> str:
        """Return the trial in one line."""
        hidden = ", ".join(f"{e}/{f} {r:.1f}" for e, f, r in zip(self.hidden, self.forms, self.ratios, strict=True))
        said = "; ".join(
            f"{s.effect}/{s.form}"
            + (f" or {', '.join(s.alternatives)}" if s.alternatives else "")
            + f" (p {s.probability:.2f}, {s.evidence:.0f} nats, size {s.size:.2f})"
            for s in self.said
        )
        without = f" without {self.excluded}" if self.excluded else ""
        why = self.refused or "; ".join(self.reasons)
        if self.worse > 0.0:
            why += f" held-out {self.worse:.2%} worse than before"
        return (
            f"{self.name} {self.kind}{without} [{hidden}] -> {self.verdict or 'refused'}: {said or 'nothing'} | {why}"
        )

    def as_dict(self) -> dict[str, Any]:
        """Return the record that :meth:`from_dict` reads."""
        return asdict(self)

    @classmethod
    def from_dict(cls, record: dict[str, Any]) -> Trial:
        """Return a trial from its record."""
        values: dict[str, Any] = {
            key: tuple(value) if isinstance(value, list) else value for key, value in record.items()
        }
        values["said"] = tuple(Said(**(s | {"alternatives": tuple(s["alternatives"])})) for s in record["said"])
        values["estimates"] = tuple(Estimate(**e) for e in record["estimates"])
        return cls(**values)


def trials_of(folder: Path, name: str, *, exclude: bool = True, told: bool = False) -> list[Trial]:
    """Diagnose a written campaign; a strong single effect once more with that effect taken out of the library.

    ``truth.json`` says what is hidden and, for another robot, its ``robot_file``, from the campaign's folder. If
    ``told``, the diagnosis knows how well the machine's joints are made: the truth must state it.
    """
    truth = json.loads((folder / "truth.json").read_text(encoding="utf-8"))
    made_within = truth["workmanship"]["centres_sd_mm"] if told else None
    found = [trial_of(folder, name, truth, DiagnosisOptions(made_within_mm=made_within))]
    if exclude and truth["kind"] == "single" and found[0].ratios[0] >= STRONG:
        found.append(trial_of(folder, name, truth, DiagnosisOptions(found[0].hidden, made_within_mm=made_within)))
    return found


def rig_trials(campaign: Campaign, name: str, *, exclude: bool = True) -> list[Trial]:
    """Write a campaign of the rig to a file, as users have it, and diagnose it."""
    with tempfile.TemporaryDirectory() as scratch:
        return trials_of(write_case(Path(scratch), campaign), name, exclude=exclude)


def trial_of(folder: Path, name: str, truth: dict[str, Any], options: DiagnosisOptions) -> Trial:
    """Diagnose a written campaign and keep the result. A refusal and a crash are kept, too."""
    hidden = truth["effects"]
    seed = truth.get("seed", ())
    known: dict[str, Any] = {
        "name": name,
        "seed": tuple(seed) if isinstance(seed, Sequence) else (seed,),
        "kind": truth["kind"],
        "hidden": tuple(e["effect"] for e in hidden),
        "forms": tuple(e.get("form", "") for e in hidden),
        "ratios": tuple(float(e["ratio_to_noise"]) for e in hidden),
        "accept": tuple(truth.get("accept", ())),
        "workmanship": bool(truth.get("background", False)),
        "excluded": "".join(options.exclude),
    }
    started = time.perf_counter()
    try:
        model = RobotModel.of(folder / truth["robot_file"] if "robot_file" in truth else None)
        campaign = MeasuredCampaign.read(folder / "campaign.csv", model.definition)
        started = time.perf_counter()
        found = diagnose(campaign, model, options)
    except PouringRobotError as problem:
        return Trial(**known, seconds=time.perf_counter() - started, refused=str(problem))
    except Exception:  # a crash is a result of the benchmark and must not end it
        return Trial(**known, seconds=time.perf_counter() - started, refused=f"crash: {traceback.format_exc()}")
    return Trial(**known, **_kept(found, truth), seconds=time.perf_counter() - started)


def _kept(found: Diagnosis, truth: dict[str, Any]) -> dict[str, Any]:
    causes = [named.cause for named in found.effects]
    held = found.held_out
    which = ("before", "after", "floor")
    return {
        "rows": len(found.campaign),
        "verdict": found.judgement.verdict,
        "said": tuple(Said(c.effect, c.form, c.alternatives, c.probability, c.evidence, c.size) for c in causes),
        "reasons": found.judgement.reasons,
        "gap": tuple(1e3 * held.position(k) for k in which) if held else (math.nan,) * 3,
        "turn_gap": tuple(1e3 * held.rotation(k) for k in which) if held else (math.nan,) * 3,
        "unknown_size": found.judgement.unknown_size,
        "closed": held.closed if held else math.nan,
        "estimates": tuple(_estimates(found, truth)),
    }


def _estimates(found: Diagnosis, truth: dict[str, Any]) -> list[Estimate]:
    """Return the parameters that have the meaning of a true constant of the rig."""
    known = {e["effect"]: e.get("parameters", {}) for e in truth["effects"]}
    estimates = []
    for named in found.effects:
        effect, values = named.cause.effect, known.get(named.cause.effect, {})
        if named.cause.form not in TEXTBOOK.get(effect, (named.cause.form,)):
            continue
        for p in named.parameters:
            true = values.get(p.parameter.name)
            if true is not None and true["unit"] == p.parameter.unit:
                estimates.append(
                    Estimate(effect, p.parameter.name, p.parameter.unit, p.value, p.std, float(true["value"]))
                )
    return estimates
