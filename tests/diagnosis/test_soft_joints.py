"""Joints that turn under load, from the energy of compliant loop closures: detected, but no cause."""

import dataclasses

import numpy as np
import pinocchio as pin
import pytest

from pouring_robot import diagnose
from pouring_robot.diagnosis import DiagnosisOptions
from pouring_robot.diagnosis.report.notes import note_lines
from tests.effects.bench import (
    BASE,
    SIGMA_M,
    SIGMA_RAD,
    TARE_KG,
    TARGET,
    Bench,
    carried,
    soft_against_turning,
    stiff_drawing,
)

STIFFNESS = 1e8


@pytest.fixture(scope="module")
def bench():
    return Bench(rows=80, sessions=1)


@pytest.fixture(scope="module")
def campaign(bench, drawing):
    """Measurements, with noise, of a machine whose closures yield in rotation."""
    mechanism, rng = soft_against_turning(stiff_drawing(), STIFFNESS), np.random.default_rng(4)
    before, behind = (pin.SE3(pin.exp3(frame[3:]), frame[:3]) for frame in (BASE, TARGET))
    rows = zip(bench.campaign.drives, bench.scene.payload_kg, strict=True)
    seen = [before * carried(mechanism, drawing, drives, TARE_KG + payload) * behind for drives, payload in rows]
    position = np.array([pose.translation for pose in seen]) + SIGMA_M * rng.normal(size=(len(seen), 3))
    turns = [pin.log3(pin.exp3(SIGMA_RAD * rng.normal(size=3)) @ pose.rotation) for pose in seen]
    return dataclasses.replace(bench.campaign, position_m=position, rotation_vector_rad=np.array(turns))


@pytest.fixture(scope="module")
def found(campaign):
    """The diagnosis of it."""
    return diagnose(campaign)


def test_soft_joints_are_detected_and_not_named(found):
    assert found.hypothesis.items[0].form == "soft_joints"
    assert not found.effects
    assert found.verdict == "unknown"
    assert "soft joints" in found.judgement.reasons[0]


def test_their_compliance_is_found(found):
    """Four of the six joints of a chain twist a leg, all by the same amount: together as much as its closure here."""
    hypothesis, assumed = found.hypothesis, found.diagnoser.rows.conditions.robot.mechanism().loops.stiffness
    at = sum(len(weights) for weights in hypothesis.weights()[: -len(hypothesis.items)])
    softness = hypothesis.coefficients()[0][at] * hypothesis.scales[0].main / assumed.rotation.value
    assert 4.0 * softness == pytest.approx(1.0 / STIFFNESS, rel=0.02)


def test_with_a_cause_a_note_says_that_the_model_has_no_soft_joints(campaign, found):
    drives = np.array(campaign.drives)
    drives[:, 0] -= 1e-3
    other = diagnose(dataclasses.replace(campaign, drives=drives), options=DiagnosisOptions(next_count=0))
    assert other.effects
    assert other.train.position("after") > 1.2 * other.train.position("floor")
    (note,) = (line for line in note_lines(other) if "soft joints" in line)
    assert "not in the model" in note
    assert not any("soft joints" in line for line in note_lines(found))  # there they are the reason for the verdict
