"""The one-hour soak study, in a few seconds: it detects growth, and its commands run."""

from __future__ import annotations

import pytest

from scripts.studies import soak


def test_a_leak_of_memory_is_seen_and_a_sound_program_passes(monkeypatch, capsys):
    held = []
    monkeypatch.setattr(soak, "one_round", lambda seed, _: held.append(b"%d" % seed * (16 << 20)))
    assert soak.main(["--minutes", "0"]) == 1
    held.clear()
    monkeypatch.setattr(soak, "one_round", lambda *_: None)
    assert soak.main(["--minutes", "0"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 2 * (2 + soak.PARTS)


def test_a_round_runs_its_commands_and_a_failure_stops_it(monkeypatch, tmp_path):
    quick = [line for line in soak.ROUND.strip().splitlines() if line.startswith("thermal")]
    monkeypatch.setattr(soak, "ROUND", "\n".join(quick))
    soak.one_round(1, tmp_path)
    assert (tmp_path / "t.csv").is_file()
    with pytest.raises(SystemExit, match="exit code 2"):  # the files are there
        soak.one_round(1, tmp_path)
