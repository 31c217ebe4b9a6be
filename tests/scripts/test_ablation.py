"""The ablation switches off choices that exist: a renamed one would have no effect, and look superfluous."""

from unittest.mock import patch

import pytest

from scripts.studies import ablation


@pytest.mark.parametrize("choice", ablation.CHOICES)
def test_what_a_choice_replaces_is_there(choice):
    try:
        ablation.CHOICES[choice]()
    finally:
        patch.stopall()


def test_campaigns_are_chosen_as_for_the_blind_trials(tmp_path, capsys):
    assert ablation.main(["--folder", str(tmp_path), "--without", "several length scales"]) == 0
    assert "as it is: 0 of 0 right" in capsys.readouterr().out
    with pytest.raises(SystemExit):
        ablation.main(["--without", "no such choice"])
