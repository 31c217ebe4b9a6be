"""The search of a diagnosis: what is found is put into the robot, which is linearised again until convergence."""

from __future__ import annotations

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
from pouring_robot.effects.stack_in_rows import local_changes
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
"""Most linearisations of one answer, between two searches and at the end; most answers converge after one or two."""
_SETTLED, _EXACT = 0.02, 1e-3
_HALVINGS = 6
_BENT = 0.3
"""In noise standard deviations: in a hundred equations such an error has 4.5 nats, the evidence that a cause needs."""
_TRIED = 3
"""Effects that are settled each alone where the drawing's derivatives do not suffice: as many as the search tries."""
_FREE = 1e-9
"""Prior precision of a free unknown over that of the data: negligible, but enough where only rounding determines it."""
_TRUST = 0.25
"""Largest squared error of a step's linear prediction, as a share of the step's square."""


@dataclass(frozen=True, eq=False)
class State:
    """A robot with changes put in, and the residuals of the rows there."""

    parameters: tuple[EffectParameter, ...]  # what is changed: effects' and workmanship's parameters
    values: FloatArray  # one for each parameter, in its unit
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
    """The same with the rows' derivatives, which take most of the memory."""

    every_row: LinearRows

    @property
    def linear(self) -> LinearRows:
        """Residuals and derivatives of the rows that are fitted."""
        return self.every_row.of(self.fitted)

    @property
    def alone(self) -> State:
        """The same state without derivatives."""
        return State(self.parameters, self.values, self.frames, self.every_row.alone, self.fitted)


class Answer(NamedTuple):
    """What was found, with the rows that it is fitted to."""

    diagnoser: Diagnoser  # of these rows
    state: State  # what was found is put in
    hypothesis: Hypothesis  # of the problem there

    @property
    def units(self) -> dict[tuple[str, str], FloatArray]:
        """Matrix from the coefficients to the parameters of each form, (p, k), in their units."""
        return self.diagnoser.units(self.hypothesis)


class _Followed(NamedTuple):
    """Result of a search."""

    state: LinearState
    hypothesis: Hypothesis  # of the problem there
    bent: float  # largest difference of a step from its linear prediction, in noise units (root mean square)


@dataclass(frozen=True, eq=False)
class Diagnoser:
    """Searches a campaign for effects; the robot is linearised again at every answer, so that it is exact."""

    rows: CampaignRows  # the campaign
    library: Library  # what may be found
    fitted: BoolArray  # rows that may be fitted, (n,); the others play no part
    asked: Thresholds = DEFAULT_THRESHOLDS  # that hold in any campaign

    @functools.cached_property
    def _frames_at_rest(self) -> OuterAndSessionFrames:
        return self.rows.refined_frames(self.fitted)

    def at_rest(self) -> LinearState:
        """Return the state without any change, its frames refined; computed on each call, as it is large."""
        return self._state((), np.zeros(0), self._frames_at_rest)

    @functools.cached_property
    def _gap_squared(self) -> float:
        linear = self.at_rest().linear
        return float(np.square(Nuisance.of(linear.free).cleared(linear.residual)).sum())

    @functools.cached_property
    def thresholds(self) -> Thresholds:
        """Thresholds in this campaign, including the evidence that the best of all effects has by chance."""
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
        """Return the search's problem linearised at a state, for the fitted rows or with held-out rows included.

        The first-order effect of the state's own changes is added to the residual again, so that they can be found.
        """
        if of_every_row:
            return self._problem(state, state.every_row, self.library)
        problem = self._problem(state, state.linear, self.library)
        if state.frames is self._frames_at_rest:  # computed separately it would linearise all rows once more
            vars(self)["_gap_squared"] = float(problem.residual @ problem.residual)
        return replace(problem, given_squared=self._gap_squared)

    def _problem(self, state: State, linear: LinearRows, library: Library) -> Problem:
        residual = linear.residual + self._signature(state.parameters, state.values, linear)
        workmanship = workmanship_of(self.rows, linear, library)
        return Problem.build(residual, linear.free, workmanship, known_effects(self.rows, linear, library))

    def found(self, start: Hypothesis | None = None, at: State | None = None) -> tuple[LinearState, Hypothesis]:
        """Search, put in what was found, and search again from there until the answer no longer changes.

        It starts with nothing, or with what was found in other rows of the same campaign; at rest, or at the state
        found under another noise. The hypothesis is of the problem of the state returned with it.

        Far from the drawing, one cause may look like another to first order. Where a step differs from its linear
        prediction by a share of the noise, the causes that look best at rest and were not refused are each settled
        alone, too, and the search continues from the best of them if it is clearly better.
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
        """Put in what a search begins with, and search again from there until the answer no longer changes."""
        state = self._state(at.parameters, at.values, at.frames) if at else self.at_rest()
        hypothesis, bent = begin(state), 0.0
        for _ in range(_ROUNDS):
            if not hypothesis.items and not any(hypothesis.levels):
                break
            keys = hypothesis.keys
            for _ in range(_STEPS):  # here, so that earlier states are freed, which are large
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
        """Put in what a hypothesis found until values, scales and frames converge, with its items kept."""
        state, hypothesis, _ = self._converged(state, hypothesis)
        return state, hypothesis.on(self.problem_at(state))

    def _converged(self, state: LinearState, hypothesis: Hypothesis) -> tuple[LinearState, Hypothesis, float]:
        """Do so in a problem without all other effects; also return the last step's linearity error."""
        for _ in range(_MOST_STEPS):
            state, hypothesis, moved = self._stepped(state, hypothesis)
            if not _EXACT <= moved < math.inf:
                break
        return state, hypothesis, moved

    def fitted_to_all(self, state: LinearState, hypothesis: Hypothesis) -> tuple[Diagnoser, LinearState, Hypothesis]:
        """Return what a hypothesis found as fitted to all rows, held-out ones too, and by which diagnoser.

        Its problem is without all other effects. Where this fit does not converge, or a level of workmanship vanishes,
        the given fit is returned.
        """
        everyone = np.ones_like(self.fitted)
        whole, there = replace(self, fitted=everyone), replace(state, fitted=everyone)
        there, best, moved = whole._converged(there, self.of_every_row(state, hypothesis).settled())
        same = [one.key for one in best.fitted] == [one.key for one in hypothesis.fitted]
        return (whole, there, best) if same and moved < _SETTLED else (self, state, hypothesis)

    def _stepped(self, state: LinearState, hypothesis: Hypothesis) -> tuple[LinearState, Hypothesis, float]:
        """Put in what a hypothesis found and settle it there without other effects; also return the linearity error."""
        state, moved = self._advanced(state, hypothesis)
        return state, self._alone_on(state, state.linear, hypothesis).settled(), moved

    def _alone_on(self, state: State, linear: LinearRows, hypothesis: Hypothesis) -> Hypothesis:
        """Return a hypothesis at a state, without all other effects."""
        found = {key: form for key, form in self.library.forms.items() if key in hypothesis.keys}
        return hypothesis.on(self._problem(state, linear, replace(self.library, forms=found)))

    def of_every_row(self, state: LinearState, hypothesis: Hypothesis) -> Hypothesis:
        """Return a hypothesis of the fitted rows on all rows, held-out ones included, without all other effects."""
        return self._alone_on(state, state.every_row, hypothesis)

    def _first(self, state: LinearState, start: Hypothesis | None) -> Hypothesis:
        """Search at a state where nothing was found yet."""
        problem = self.problem_at(state)
        if "thresholds" not in vars(self):  # computed separately they would linearise all rows once more
            vars(self)["thresholds"] = self._thresholds_in(problem)
        if start and not start.keys <= {item.key for item in problem.explanations}:
            start = None  # other rows may have no such form: another session, forces that differ by less
        return search(problem, self.thresholds, start.on(problem) if start else None)

    def _alone(self, key: tuple[str, str]) -> tuple[State, Hypothesis]:
        """Return one form alone, settled, and its state."""
        state, library = self.at_rest(), replace(self.library, forms={key: self.library.forms[key]})
        nothing = Hypothesis.nothing(self._problem(state, state.linear, library))
        (item,) = (item for item in nothing.problem.explanations if item.key == key)
        single = nothing.with_item(item)
        state, single = self.settled(state, single)
        return state.alone, single

    def parameters_of(self, hypothesis: Hypothesis, covariances: tuple[FloatArray, ...] = ()) -> FoundByKey:
        """Return the parameters of every group of a hypothesis that are the robot's: workmanship, then items.

        Their standard deviations are from ``covariances``, see :meth:`covariances`; by default from the hypothesis.
        """
        (mean, own), found = hypothesis.coefficients(), []
        for key, units in self.units(hypothesis).items():
            std = largest_std(units, covariances or (own,))
            values = zip(self.library.every_form[key].parameters, (units @ mean).tolist(), std.tolist(), strict=True)
            found.append((key, tuple(FoundParameter(*each, self.rows.noise.dof) for each in values)))
        return found

    def units(self, hypothesis: Hypothesis) -> dict[tuple[str, str], FloatArray]:
        """Return the matrix from a hypothesis's coefficients to the parameters of each form, (p, k), in their units."""
        forms, width, found = self.library.every_form, sum(map(len, hypothesis.weights())), {}
        for group, weights, own in zip(hypothesis.fitted, hypothesis.weights(), hypothesis.spans, strict=True):
            if form := forms.get(group.key):
                units = np.diag(weights * np.array([p.prior_std for p in form.parameters]))
                found[group.key] = np.zeros((len(weights), width))
                found[group.key][:, own] = (
                    form.reporting_matrix(self.fitted) @ units if form.reporting_matrix else units
                )
        return found

    def covariances(
        self, hypothesis: Hypothesis, state: LinearState, *, unexplained: bool = False
    ) -> tuple[FloatArray, ...]:
        """Return covariances of all fitted coefficients, (k, k), of which the larger counts.

        At the state of the hypothesis. Where it leaves more than noise (``unexplained``), the second is the scatter of
        the coefficients over stretches of time (:mod:`pouring_robot.estimation.jackknife`). Each includes the error of
        the coefficients from frames that are wrong along the directions that are held.
        """
        own = hypothesis.coefficients()[1]
        covariances = (own, self._scattered(hypothesis, state)) if unexplained else (own,)
        columns = [(group.columns[:] * by).T for group, by in zip(hypothesis.fitted, hypothesis.weights(), strict=True)]
        off = own @ (np.vstack(columns) @ state.linear.held) if columns else own
        return tuple(covariance + off @ off.T for covariance in covariances)

    def _scattered(self, hypothesis: Hypothesis, state: State) -> FloatArray:
        """Return the covariance of all fitted coefficients from a jackknife over stretches of time, (k, k)."""
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
        """Return the causes of a judgement with their parameters, as found by :meth:`parameters_of`."""
        known, effects, named = dict(found), self.library.effects, []
        for cause in judgement.causes:
            parameters = tuple(one for key in cause.keys(hypothesis) for one in known[key])
            nearest = cause.effect in judgement.doubtful
            named.append(NamedEffect(cause, nearest, effects[cause.effect].story, parameters))
        return tuple(named)

    def added(self, hypothesis: Hypothesis, effect: str, linear: LinearRows) -> Channel:
        """Return the first-order part of an effect in the whitened prediction, with the frames held.

        A varying size changes this, not what remains of it after the frames are fitted.
        """
        forms = [hypothesis.items[k].key for k in hypothesis.of_effect(effect)]
        found = [one for key, group in self.parameters_of(hypothesis) if key in forms for one in group]
        changes = local_changes([one.parameter for one in found], [one.value for one in found])
        return self.rows.moving(effect, changes, linear, sums_of(linear.row, len(self.rows)))

    def _advanced(self, state: LinearState, hypothesis: Hypothesis) -> tuple[LinearState, float]:
        """Put in what a hypothesis found; also return the difference from its linear prediction (noise units).

        A partial step's difference is scaled to the whole step by the square of its share. Where no share of the step
        is acceptable, the state stays and the difference is infinite.
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
            with suppress(DiagnosisError):  # with rows that do not close or are singular, the step is halved
                there = self._put_in(put, values, frames)
                gone = before - self._signature(put, values, linear) - linear.frame_columns @ (share * step)
                off = there.alone.of(self.fitted).residual - (linear.residual + gone)
                # A step whose error is more than half of its length is beyond the range of the derivatives, and may
                # oscillate if it gains less than half of what it should: with both it is halved.
                predicted = now + gone
                reached = predicted + off
                gains = reached @ reached <= 0.5 * (now @ now + predicted @ predicted)
                if gains or off @ off <= _TRUST * (gone @ gone) + _EXACT**2 * len(off):
                    # Derivatives take as long as closing the loops, so only for a step that is accepted.
                    new = LinearState(put, values, frames, self.rows.linearised(there), self.fitted)
                    return new, rms(off) / share**2
        return state, math.inf

    def _signature(self, parameters: tuple[EffectParameter, ...], values: FloatArray, linear: LinearRows) -> FloatArray:
        """Return the first-order part of parameters in the prediction, whitened, (m,)."""
        return self.rows.signature(local_changes(parameters, values.tolist()), linear)


def _way(state: State, found: Sequence[FoundParameter]) -> tuple[tuple[EffectParameter, ...], FloatArray, FloatArray]:
    """Return parameters and their values, (p,) each, in a state and as found; last, those no longer found, as zero."""
    left = state.by_parameter
    here = [(one.parameter, left[one.parameter].pop(0) if left.get(one.parameter) else 0.0) for one in found]
    here += [(parameter, value) for parameter, values in left.items() for value in values]
    parameters, values = zip(*here, strict=True) if here else ((), ())
    wanted = np.zeros(len(here))
    wanted[: len(found)] = [one.value for one in found]
    return parameters, np.array(values), wanted


def noise_left(noise: NoiseLevel, after: State, hypothesis: Hypothesis) -> NoiseLevel:
    """Return the noise with that of all measured kinds estimated from the residual of a hypothesis."""
    component = after.fitted_rows.component
    return noise.from_left_over(noise.measured, component, hypothesis.remainder, hypothesis.freedom, fewest=0.0)
