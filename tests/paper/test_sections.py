"""The other sections: verdicts that follow from the study, and a study that follows from plain figures."""

import dataclasses

import numpy as np
import pytest

from scripts.paper.sections import JUDGES, SectionsReport, run_sections_study


@pytest.fixture(scope="module")
def study():
    patch = pytest.MonkeyPatch()
    for name, count in {"_POSES": 100, "_WEIGHED": 4, "_HEATED": 2}.items():
        patch.setattr(f"scripts.paper.sections.{name}", count)
    try:
        return run_sections_study("paper", 2022)
    finally:
        patch.undo()


def verdicts(study):
    return {claim.key: claim.verdict for claim in (judged(study) for judged in JUDGES)}


def test_verdicts(study):
    said = verdicts(study)
    assert {key for key, verdict in said.items() if verdict == "cannot be checked"} == {
        "payload",
        "three_sources",
        "left_aside",
    }
    assert {"strokes", "one_centimetre", "heat_share", "weight", "concentrated"} <= {
        key for key, verdict in said.items() if verdict == "differs"
    }
    for key in ("wide_influence", "by_least_squares", "by_network", "machining"):
        assert said[key] == "reproduced", key


@pytest.mark.parametrize(
    ("changes", "key", "verdict"),
    [
        (lambda s: {"sag_m": 0.01 * s.sag_m}, "weight", "reproduced"),
        (lambda s: {"left_m": dict.fromkeys(s.left_m, 0.2 * s.before_m)}, "by_network", "differs"),
        (
            lambda s: {"shares": np.stack([*s.shares[:2], s.shares[:2].sum(axis=0)])},
            "additive",
            "reproduced",
        ),
        (lambda s: {"shares": s.shares * np.array([1.0, 20.0, 1.0])[:, None, None]}, "heat_share", "reproduced"),
    ],
)
def test_other_figures_get_other_verdicts(study, changes, key, verdict):
    assert verdicts(dataclasses.replace(study, **changes(study)))[key] == verdict


def test_chains_that_lean_otherwise_are_told(study):
    """Chain 2 with chain 3's joint values: S12 and S22 are no longer parallel."""
    assert verdicts(study)["axes"] == "reproduced"
    command = study.geometry.command
    turned = command.start.joints.copy()
    turned[:, 1] = turned[:, 2]
    moved = dataclasses.replace(command, start=dataclasses.replace(command.start, joints=turned))
    other = dataclasses.replace(study, geometry=dataclasses.replace(study.geometry, command=moved))
    assert verdicts(other)["axes"] == "differs"


def test_least_squares_comes_down_to_the_noise(study):
    """300 positions of 0.02 mm noise, some 50 directions seen: about 0.02 mm · √(50 / 300) is left."""
    assert study.left_m["least squares"] < 0.02e-3 < study.left_m["network"] < 0.1 * study.before_m


def test_what_the_network_leaves_is_given_as_exactly_as_machines_agree(study):
    def said(left):
        changed = dataclasses.replace(study, left_m=study.left_m | {"network": left * study.before_m})
        return next(claim for judged in JUDGES if (claim := judged(changed)).key == "by_network").computed

    assert said(0.0131) == said(0.0137) and "1 % of it" in said(0.0131)


def test_every_claim_has_a_reason_and_is_printed(study):
    report = SectionsReport.of(study)
    assert all(claim.why for claim in report.claims)
    assert all(claim.rule for claim in report.claims if claim.verdict != "cannot be checked")
    text = " ".join(report.text().split())
    assert "15 claims" in text and "no measured data" in text
    assert [row["key"] for row in report.claim_rows()] == [claim.key for claim in report.claims]
