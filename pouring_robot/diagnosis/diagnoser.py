"""The search of a diagnosis: what is found is put into the robot, which is linearised again until nothing moves."""

import functools
import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from pouring_robot.diagnosis.library import Library, known_effects, workmanship_of
from pouring_robot.diagnosis.named_effects import FoundByKey, FoundParameter, NamedEffect
from pouring_robot.diagnosis.rows import CampaignRows, ClosedRows, LinearRows, OuterAndSessionFrames, WhitenedRows
from pouring_robot.effects.base import EffectParameter
from pouring_robot.effects.stack import local_changes
from pouring_robot.estimation.intervals import largest_std
from pouring_robot.estimation.jackknife import jackknife_covariance
from pouring_robot.estimation.noise import NoiseLevel
from pouring_robot.estimation.splits import blocks
from pouring_robot.exceptions import DiagnosisError
from pouring_robot.inference.decision import Judgement
from pouring_robot.inference.gaussian_processes.processes import Channel, sums_of
from pouring_robot.inference.hypotheses import Hypothesis
from pouring_robot.inference.problem import Nuisance, Problem
from pouring_robot.inference.search import best_forms, search
from pouring_robot.inference.thresholds import DEFAULT_THRESHOLDS, Thresholds, chance_level
from pouring_robot.mechanism.arrays import BoolArray, FloatArray, rms

_ROUNDS = 4
_STEPS, _MOST_STEPS = 4, 12
"""Of one answer, between two searches and at the end; most stay after one or two."""
_SETTLED, _EXACT = 0.02, 1e-3
_HALVINGS = 6
_BENT = 0.3
"""Noise deviations: over a hundred equations what is off by as much tells 4.5 nats, as one more cause has to."""
_TRIED = 3
"""Effects that are settled each alone where the drawing's derivatives do not tell: as many as the search tries."""
_FREE = 1e-9
"""Prior of a free unknown over all that the rows tell of it: it holds none, where rounding alone would tell of it."""
_TRUST = 0.25
"""Share of a step's square that it may be off from its linear prediction."""


@dataclass(frozen=True, eq=False)
class State:
    """A robot with changes put in, and the rows as they look from there."""

    parameters: tuple[EffectParameter, ...]  # what is changed: effects' and workmanship's parameters
    values: FloatArray  # one a parameter, in its unit
    frames: OuterAndSessionFrames  # the two frames
    every_row: WhitenedRows  # residuals there
    fitted: BoolArray  # which rows are fitted, (n,)

    @property
    def by_parameter(self) -> dict[EffectParameter, list[float]]:
        """Values by parameter: two forms of one effect may share one, which then has two values that add up."""
        found: dict[EffectParameter, list[float]] = {}
        for parameter, value in zip(self.parameters, self.values.tolist(), strict=True):
            found.setdefault(parameter, []).append(value)
        return found

    @property
    def fitted_rows(self) -> WhitenedRows:
        """Residuals of the rows that are fitted."""
        return self.every_row.alone.of(self.fitted)


@dataclass(frozen=True, eq=False)
class LinearState(State):
    """The same with the rows' derivatives, which of many rows take most of the room."""

    every_row: LinearRows

    @property
    def linear(self) -> LinearRows:
        """Residuals and derivatives of the rows that are fitted."""
        return self.every_row.of(self.fitted)

    @property
    def alone(self) -> State:
        """It without derivatives."""
        return State(self.parameters, self.values, self.frames, self.every_row.alone, self.fitted)


class _Followed(NamedTuple):
    """Where a search came to."""

    state: LinearState
    hypothesis: Hypothesis  # of the problem there
    bent: float  # most that a step differed from its linear prediction, in noise units (root mean square)


@dataclass(frozen=True, eq=False)
class Diagnoser:
    """Searches a campaign for effects, exactly: the robot is linearised again at every answer."""

    rows: CampaignRows  # the campaign
    library: Library  # what may be found
    fitted: BoolArray  # rows that may be fitted, (n,); the others play no part
    asked: Thresholds = DEFAULT_THRESHOLDS  # that hold in any campaign

    @functools.cached_property
    def _frames_at_rest(self) -> OuterAndSessionFrames:
        return self.rows.refined_frames(self.fitted)

    def at_rest(self) -> LinearState:
        """Return the state without any change, its frames refined; made when asked for, as it is large."""
        return self._state((), np.zeros(0), self._frames_at_rest)

    @functools.cached_property
    def _gap_squared(self) -> float:
        linear = self.at_rest().linear
        return float(np.square(Nuisance.of(linear.free).cleared(linear.residual)).sum())

    @functools.cached_property
    def thresholds(self) -> Thresholds:
        """Those that hold in this campaign: by chance the best of all effects is worth something."""
        return self._thresholds_in(self.problem_at(self.at_rest()))

    def _thresholds_in(self, problem: Problem) -> Thresholds:
        return replace(self.asked, by_chance=chance_level(Hypothesis.nothing(problem), self.asked.false_names))

    def _state(
        self, parameters: tuple[EffectParameter, ...], values: FloatArray, frames: OuterAndSessionFrames
    ) -> LinearState:
        every_row = self.rows.linearised(self._put_in(parameters, values, frames))
        return LinearState(parameters, values, frames, every_row, self.fitted)

    def _put_in(
        self, parameters: tuple[EffectParameter, ...], values: FloatArray, frames: OuterAndSessionFrames
    ) -> ClosedRows:
        return self.rows.seen(self.rows.changes(parameters, values), frames)

    def problem_at(self, state: LinearState, *, of_every_row: bool = False) -> Problem:
        """Return the search's problem linearised at a state for the fitted rows, or with those held out among them.

        What the state's own changes add to the prediction to first order is given back: they are to be found again.
        """
        if of_every_row:
            return self._problem(state, state.every_row, self.library)
        problem = self._problem(state, state.linear, self.library)
        if state.frames is self._frames_at_rest:  # worked out by itself it would linearise all rows once more
            vars(self)["_gap_squared"] = float(problem.residual @ problem.residual)
        return replace(problem, given_squared=self._gap_squared)

    def _problem(self, state: State, linear: LinearRows, library: Library) -> Problem:
        residual = linear.residual + self._signature(state.parameters, state.values, linear)
        workmanship = workmanship_of(self.rows, linear, library)
        return Problem.build(residual, linear.free, workmanship, known_effects(self.rows, linear, library))

    def found(self, start: Hypothesis | None = None, at: State | None = None) -> tuple[LinearState, Hypothesis]:
        """Search, put in what was found, and search again from there until the answer stays.

        It starts with nothing, or with what was found in other rows of the same campaign; at rest, or at the state that
        other noise led to. The hypothesis is of the problem of the state returned with it.

        Far from the drawing one cause looks like another there, to first order: where a step bends by a share of the
        noise, the causes that look best at rest and were not refused are each settled alone, too, and the best of them
        is followed if it is clearly better.
        """
        likely: list[tuple[str, str]] = []

        def begun(state: LinearState) -> Hypothesis:
            first = self._first(state, start)
            likely.extend(best_forms(first.problem, _TRIED))
            return first

        best = self._followed(begun, at)
        if best.bent > _BENT and not start:
            known, refused = best.hypothesis.effects, best.hypothesis.barred
            alone = (self._alone(key) for key in likely if known != key[:1] and key not in refused)
            other = max(alone, key=lambda found: found[1].log_evidence, default=None)
            if other and other[1].log_evidence > best.hypothesis.log_evidence + self.thresholds.least_evidence:
                at, single = other
                best = self._followed(lambda _: single, at)
        return best.state, best.hypothesis

    def _followed(self, begin: Callable[[LinearState], Hypothesis], at: State | None = None) -> _Followed:
        """Put in what a search begins with, and search again from there until the answer stays."""
        state = self._state(at.parameters, at.values, at.frames) if at else self.at_rest()
        hypothesis, bent = begin(state), 0.0
        for _ in range(_ROUNDS):
            if not hypothesis.items and not any(hypothesis.levels):
                break
            keys = hypothesis.keys
            for _ in range(_STEPS):  # here, so that the first states are let go, of many rows large
                state, hypothesis, moved = self._stepped(state, hypothesis)
                bent = max(bent, moved)
                if not _SETTLED <= moved < math.inf:
                    break
            hypothesis = hypothesis.on(self.problem_at(state))
            hypothesis = search(hypothesis.problem, self.thresholds, hypothesis)
            if hypothesis.keys == keys:
                break
        return _Followed(*self.settled(state, hypothesis), bent)

    def settled(self, state: LinearState, hypothesis: Hypothesis) -> tuple[LinearState, Hypothesis]:
        """Put in what a hypothesis found until values, scales and frames stay, its items kept."""
        for _ in range(_MOST_STEPS):
            state, hypothesis, moved = self._stepped(state, hypothesis)
            if not _EXACT <= moved < math.inf:
                break
        return state, hypothesis.on(self.problem_at(state))

    def _stepped(self, state: LinearState, hypothesis: Hypothesis) -> tuple[LinearState, Hypothesis, float]:
        """Put in what a hypothesis found, and settle it there, all other effects left out; say how far it was off."""
        state, moved = self._advanced(state, hypothesis)
        return state, self._alone_on(state, state.linear, hypothesis).settled(), moved

    def _alone_on(self, state: State, linear: LinearRows, hypothesis: Hypothesis) -> Hypothesis:
        """Return a hypothesis at a state, all other effects left out."""
        found = {key: form for key, form in self.library.forms.items() if key in hypothesis.keys}
        return hypothesis.on(self._problem(state, linear, replace(self.library, forms=found)))

    def of_every_row(self, state: LinearState, hypothesis: Hypothesis) -> Hypothesis:
        """Return what was found in the fitted rows with those held out among them, all other effects left out."""
        return self._alone_on(state, state.every_row, hypothesis)

    def _first(self, state: LinearState, start: Hypothesis | None) -> Hypothesis:
        """Search at a state that nothing was found at."""
        problem = self.problem_at(state)
        if "thresholds" not in vars(self):  # worked out by themselves they would linearise all rows once more
            vars(self)["thresholds"] = self._thresholds_in(problem)
        if start and not start.keys <= {item.key for item in problem.explanations}:
            start = None  # other rows may have no such form: another session, forces that differ by less
        return search(problem, self.thresholds, start.on(problem) if start else None)

    def _alone(self, key: tuple[str, str]) -> tuple[State, Hypothesis]:
        """Return one form alone, settled, and the state it led to."""
        state, library = self.at_rest(), replace(self.library, forms={key: self.library.forms[key]})
        nothing = Hypothesis.nothing(self._problem(state, state.linear, library))
        (item,) = (item for item in nothing.problem.explanations if item.key == key)
        single = nothing.with_item(item)
        state, single = self.settled(state, single)
        return state.alone, single

    def parameters_of(self, hypothesis: Hypothesis, covariances: tuple[FloatArray, ...] = ()) -> FoundByKey:
        """Return every group of a hypothesis that has parameters of the robot: workmanship, then items.

        Their standard deviations are as :meth:`covariances` tell them, by default as the hypothesis itself does.
        """
        (mean, own), found = hypothesis.coefficients(), []
        for key, units in self.units(hypothesis).items():
            std = largest_std(units, covariances or (own,))
            values = zip(self.library.every_form[key].parameters, (units @ mean).tolist(), std.tolist(), strict=True)
            found.append((key, tuple(FoundParameter(*each, self.rows.noise.dof) for each in values)))
        return found

    def units(self, hypothesis: Hypothesis) -> dict[tuple[str, str], FloatArray]:
        """Return what each coefficient of a hypothesis adds to the parameters of each form, (p, k), in their units."""
        forms, width, found = self.library.every_form, sum(map(len, hypothesis.weights())), {}
        for group, weights, own in zip(hypothesis.fitted, hypothesis.weights(), hypothesis.spans, strict=True):
            if form := forms.get(group.key):
                units = np.diag(weights * np.array([p.prior_std for p in form.parameters]))
                found[group.key] = np.zeros((len(weights), width))
                found[group.key][:, own] = form.told(self.fitted) @ units if form.told else units
        return found

    def covariances(
        self, hypothesis: Hypothesis, state: LinearState, *, unexplained: bool = False
    ) -> tuple[FloatArray, ...]:
        """Return those that tell coefficients of everything fitted, (k, k), of which the larger counts.

        At the state that the hypothesis is of. Where it leaves more than noise, that adds how far stretches of time
        scatter the coefficients (:mod:`pouring_robot.estimation.jackknife`). In each is what the coefficients would be
        off by where the frames stand elsewhere along directions that nothing tells.
        """
        own = hypothesis.coefficients()[1]
        told = (own, self._scattered(hypothesis, state)) if unexplained else (own,)
        seen = [(group.columns[:] * by).T for group, by in zip(hypothesis.fitted, hypothesis.weights(), strict=True)]
        off = own @ (np.vstack(seen) @ state.linear.held) if seen else own
        return tuple(covariance + off @ off.T for covariance in told)

    def _scattered(self, hypothesis: Hypothesis, state: State) -> FloatArray:
        """Return the covariance of the coefficients of everything fitted by stretches of time, (k, k)."""
        free, left, row = hypothesis.problem.nuisance, hypothesis.remainder, state.fitted_rows.row
        groups = list(zip(hypothesis.fitted, hypothesis.weights(), strict=True))
        stretches = blocks(self.rows.campaign, "time", np.flatnonzero(~self.fitted))
        parts = (
            (np.hstack([free.axes[own], *(-one.columns[own] * weights for one, weights in groups)]), left[own])
            for own in (np.isin(row, stretch) for stretch in stretches.values())
            if own.any()
        )
        means, unheld = hypothesis.coefficients()[0], np.zeros(free.dof)
        precision = np.concatenate([unheld + _FREE, np.ones_like(means)])
        found = jackknife_covariance(parts, np.concatenate([unheld, means]), precision, self.rows.noise.dof)
        return found[free.dof :, free.dof :]

    def named(self, found: FoundByKey, hypothesis: Hypothesis, judgement: Judgement) -> tuple[NamedEffect, ...]:
        """Return the causes of a judgement with their parameters, found as :meth:`parameters_of` has them."""
        known, effects, named = dict(found), self.library.effects, []
        for cause in judgement.causes:
            parameters = tuple(one for key in cause.keys(hypothesis) for one in known[key])
            nearest = cause.effect in judgement.doubtful
            named.append(NamedEffect(cause, nearest, effects[cause.effect].story, parameters))
        return tuple(named)

    def added(self, hypothesis: Hypothesis, effect: str, linear: LinearRows) -> Channel:
        """Return what an effect at work adds to the whitened prediction to first order, the frames held.

        What varies its size changes that, and not what frames leave of it.
        """
        forms = [hypothesis.items[k].key for k in hypothesis.of_effect(effect)]
        found = [one for key, group in self.parameters_of(hypothesis) if key in forms for one in group]
        changes = local_changes([one.parameter for one in found], [one.value for one in found])
        return self.rows.moving(effect, changes, linear, sums_of(linear.row, len(self.rows)))

    def _advanced(self, state: LinearState, hypothesis: Hypothesis) -> tuple[LinearState, float]:
        """Put in what a hypothesis found, and say by how much that differs from its linear prediction (noise units).

        That is of a whole step, as a square of its share. Where no share of it will do all stays, and it is infinite.
        """
        found = [one for _, group in self.parameters_of(hypothesis) for one in group]
        parameters, from_here, wanted = _way(state, found)
        linear = state.linear
        before = self._signature(state.parameters, state.values, linear)
        now = linear.residual.copy()
        for k, item in enumerate(hypothesis.items):
            if item.key not in self.library.forms:  # it has no parameters of the robot
                now -= hypothesis.part(k)
        step = linear.frame_step(now + before - self._signature(parameters, wanted, linear))
        for halved in range(_HALVINGS):
            share = 0.5**halved
            count = len(parameters) if halved else len(found)
            put, values = parameters[:count], (from_here + share * (wanted - from_here))[:count]
            frames = state.frames.moved(share * step)
            with suppress(DiagnosisError):  # rows that do not close there, or are singular, are asked nearer
                there = self._put_in(put, values, frames)
                gone = before - self._signature(put, values, linear) - linear.frame_columns @ (share * step)
                off = there.alone.of(self.fitted).residual - (linear.residual + gone)
                # A step that is off by more than half of what it moves is outside of what the derivatives say, and one
                # that gains less than half of what it should may lead back and forth: they are asked nearer.
                foretold = now + gone
                reached = foretold + off
                gains = reached @ reached <= 0.5 * (now @ now + foretold @ foretold)
                if gains or off @ off <= _TRUST * (gone @ gone) + _EXACT**2 * len(off):
                    # Of a step that is refused nobody wants the derivatives, which take as long as closing it.
                    new = LinearState(put, values, frames, self.rows.linearised(there), self.fitted)
                    return new, rms(off) / share**2
        return state, math.inf

    def _signature(self, parameters: tuple[EffectParameter, ...], values: FloatArray, linear: LinearRows) -> FloatArray:
        """Return what parameters add to the prediction to first order, whitened, (m,)."""
        return self.rows.signature(local_changes(parameters, values.tolist()), linear)


def _way(state: State, found: Sequence[FoundParameter]) -> tuple[tuple[EffectParameter, ...], FloatArray, FloatArray]:
    """Return parameters and their values, (p,) each, in a state and as found: behind those, what is found no more."""
    left = state.by_parameter
    here = [(one.parameter, left[one.parameter].pop(0) if left.get(one.parameter) else 0.0) for one in found]
    here += [(parameter, value) for parameter, values in left.items() for value in values]
    parameters, values = zip(*here, strict=True) if here else ((), ())
    wanted = np.zeros(len(here))
    wanted[: len(found)] = [one.value for one in found]
    return parameters, np.array(values), wanted


def noise_left(noise: NoiseLevel, after: State, hypothesis: Hypothesis) -> NoiseLevel:
    """Return the noise with that of all that was measured taken from what a hypothesis leaves over."""
    component = after.fitted_rows.component
    return noise.from_left_over(noise.measured, component, hypothesis.remainder, hypothesis.freedom, fewest=0.0)
