"""What the search found in a campaign: data, states, judgement. What follows from it: :mod:`~.conclusions`."""

import functools
from dataclasses import dataclass, replace

import numpy as np

from pouring_robot.campaign.data import Campaign
from pouring_robot.checks.flags import DataFlag
from pouring_robot.diagnosis.cross_validation import CrossValidatedGap
from pouring_robot.diagnosis.diagnoser import Answer, Diagnoser, State, noise_left
from pouring_robot.diagnosis.gap import Gap
from pouring_robot.diagnosis.named_effects import FoundByKey, FoundParameter, NamedEffect
from pouring_robot.diagnosis.rows import CampaignRows
from pouring_robot.effects.base import EffectParameter
from pouring_robot.estimation.intervals import Z95, largest_std
from pouring_robot.estimation.kinds import KINDS, Kind
from pouring_robot.estimation.noise import NoiseLevel
from pouring_robot.inference.decision import Judgement, Verdict
from pouring_robot.inference.hypotheses import Hypothesis
from pouring_robot.mechanism.arrays import BoolArray, FloatArray, Indices
from pouring_robot.robot.model import RobotModel


@dataclass(frozen=True, eq=False, repr=False)
class Findings:
    """Results of the search."""

    campaign: Campaign  # all rows of the file
    model: RobotModel  # the given model
    rows: CampaignRows  # the inliers, predicted with it
    inliers: Indices  # index in the campaign of each of them, (n,)
    left_out: Indices  # rows left out as gross errors or copies, by index in the campaign
    flags: tuple[DataFlag, ...]  # what the checks found in the data
    # of the measurements, as stated or estimated; where the residual scatters like a larger noise, ``rows`` has that
    noise: NoiseLevel
    fitted: BoolArray  # which inliers were fitted, (n,); the others are held out
    held_out_name: str  # which block is held out, in words; empty where there are too few rows to hold any out
    diagnoser: Diagnoser  # the search
    before: State  # the given model, only its frames fitted
    after: State  # what was found put in, by the fitted rows; residuals are of this one
    hypothesis: Hypothesis  # the best explanation, by the fitted rows
    final: Answer  # what is put into the model: the same, where causes are named fitted to all rows
    judgement: Judgement  # what may be said of it
    # why the answer is unknown whatever explains best: the residual is too large for noise, what was found is no
    # credible robot, or single rows of few may be wrong; "" where none applies
    misfit: str
    covariances: tuple[FloatArray, ...]  # of all coefficients of ``final``; the larger counts
    parameters: FoundByKey  # of everything fitted
    effects: tuple[NamedEffect, ...]  # the named effects with their parameters
    untestable: dict[str, tuple[str, ...]]  # effects that the campaign cannot test, with the conditions it lacks
    train: Gap  # gap of the fitted rows
    held_out: Gap | None  # gap of the held-out rows; None where there are none
    # gap of every block held out in turn, where causes are named and the rows held out are few; else None
    in_turn: CrossValidatedGap | None
    notes: tuple[str, ...]  # what limits the answer, one line each
    next_count: int  # how many measurements to suggest

    @property
    def verdict(self) -> Verdict:
        """``no_gap``, ``named``, ``group`` or ``unknown``."""
        return self.judgement.verdict

    @property
    def overfitted(self) -> bool:
        """Whether what was found by the fitted rows has larger errors in held-out ones than the given model."""
        gaps = self.held_out, self.in_turn.gap if self.in_turn else None
        return any(gap is not None and gap.worse for gap in gaps)

    @property
    def firm(self) -> tuple[NamedEffect, ...]:
        """Effects that do not merely stand in for something unknown: no description explains nearly as well."""
        return tuple(e for e in self.effects if not e.nearest)

    @property
    def nearest(self) -> tuple[NamedEffect, ...]:
        """Effects that may only stand in for something unknown: a description explains nearly as well, or better."""
        return tuple(e for e in self.effects if e.nearest)

    @functools.cached_property
    def noise_left(self) -> NoiseLevel | None:
        """The larger noise as which the residual scatters from row to row; None where it does not scatter so."""
        if not self.judgement.scatters:
            return None
        left = noise_left(self.rows.noise, self.after, self.hypothesis)
        return left if self.noisy is None else NoiseLevel({**self.noise.kinds, self.noisy: left[self.noisy]})

    @property
    def noisy(self) -> Kind | None:
        """The only kind whose noise looks larger; None where that of all kinds does, or none."""
        larger = self.judgement.larger_noise
        return None if larger is None or larger.kind is None else KINDS[larger.kind]

    @property
    def mostly_workmanship(self) -> bool:
        """Whether unnamed workmanship makes more of the gap than any named cause does."""
        squared = self.hypothesis.workmanship_squared_size / len(self.hypothesis.problem.residual)
        smaller = (cause.indices and cause.size**2 < squared for cause in self.judgement.causes)
        return self.judgement.names and all(smaller)

    @property
    def spare(self) -> dict[str, float]:
        """Log evidence that each effect neither found nor an alternative nor minor would add, in nats."""
        problem, judgement = self.hypothesis.problem, self.judgement
        shown = {item.effect for item in problem.explanations if problem.shown(item)}
        mentioned = {*judgement.minor, *(name for c in judgement.causes for name in (c.effect, *c.alternatives))}
        best = self.hypothesis.best_forms((self.hypothesis.rivals & shown) - mentioned)
        return {effect: worth.evidence for effect, (worth, _) in best.items()}

    def parameters_of(self, effect: NamedEffect) -> list[tuple[str, FoundParameter]]:
        """Return the parameters of an effect by name, with the form where two forms have one of the same name.

        A parameter that two forms share is listed once, with the sum of its values.
        """
        places: dict[EffectParameter, list[int]] = {}
        for k, found in enumerate(effect.parameters):
            places.setdefault(found.parameter, []).append(k)
        units = self.units_of(effect)
        stds = largest_std(np.array([units[own].sum(axis=0) for own in places.values()]), self.covariances).tolist()
        once = {
            p: replace(effect.parameters[own[0]], value=sum(effect.parameters[k].value for k in own), std=std)
            for (p, own), std in zip(places.items(), stds, strict=True)
        }
        names = [p.name for p in once]
        forms = [form for (known, _), form in self.diagnoser.library.forms.items() if known == effect.cause.effect]
        of = {p: f" ({form.name})" for form in reversed(forms) for p in form.parameters if names.count(p.name) > 1}
        return [(p.name + of.get(p, ""), found) for p, found in once.items()]

    def units_of(self, effect: NamedEffect) -> FloatArray:
        """Return the matrix from the hypothesis's coefficients to an effect's parameters, (p, k), in their units."""
        units = self.final.units
        return np.vstack([units[key] for key in effect.cause.keys(self.hypothesis)])

    def in_words(self, effect: NamedEffect) -> tuple[str, ...]:
        """Return what the parameters of an effect mean together, a sentence each."""
        found = self.parameters_of(effect)
        values, halves = ({name: getattr(p, which) for name, p in found} for which in ("value", "half_width"))
        stds = {name: half / Z95 for name, half in halves.items()}  # the sentences take normal values
        return self.diagnoser.library.effects[effect.cause.effect].in_words(values, stds)
