"""Cases: proportions, sizes, and files that the package reads."""

import filecmp
import json
from collections import Counter

import numpy as np
import pytest

from pouring_robot import Campaign
from tests.examiner import cases
from tests.examiner.__main__ import main


def test_every_twenty_cases_hold_the_proportions():
    kinds = Counter(kind for kind, _ in cases.plan(60, 5))
    assert kinds == {"null": 15, "single": 21, "pair": 9, "outside": 9, "confounded": 6}


@pytest.mark.parametrize("kind", ["null", "single", "outside", "confounded"])
def test_a_case_is_what_it_says(kind, tmp_path):
    case = cases.make(3, 1, kind, 1)
    cases.write(case, tmp_path, np.random.default_rng(1))
    truth = json.loads((tmp_path / "truth.json").read_text())
    assert truth["kind"] == kind
    assert len(truth["effects"]) == (kind != "null")
    assert all(0.9 < e["ratio_to_noise"] < 15.5 for e in truth["effects"])
    assert (len(truth["accept"]) > 1) == (kind in {"confounded", "null"})
    assert len(Campaign.read(tmp_path / "campaign.csv")) == len(case.rig.scene.time)


def test_a_series_hangs_on_its_seed_alone(tmp_path):
    for name in "ab":
        main(["--out", str(tmp_path / name), "--cases", "2", "--seed", "8"])
    for case in ("case_000", "case_001"):
        same, *_ = filecmp.cmpfiles(tmp_path / "a" / case, tmp_path / "b" / case, ["campaign.csv", "truth.json"])
        assert len(same) == 2
