"""Files are written whole or not at all."""

import os
import stat
from pathlib import Path

import pytest

from pouring_robot.exceptions import BadInputError, OutputError
from pouring_robot.io import files
from pouring_robot.io.files import check_folder, check_outputs, check_writable, write_together, write_whole


def test_writes_text_and_bytes_and_leaves_nothing_else(tmp_path):
    assert write_whole(tmp_path / "a.txt", "µm") == tmp_path / "a.txt"
    write_whole(tmp_path / "a.txt", b"new")
    assert (tmp_path / "a.txt").read_bytes() == b"new"
    assert [path.name for path in tmp_path.iterdir()] == ["a.txt"]


def test_keeps_the_old_file_when_writing_fails(tmp_path, monkeypatch):
    target = tmp_path / "a.txt"
    target.write_text("old")

    def interrupted(descriptor):
        raise KeyboardInterrupt

    monkeypatch.setattr(os, "fsync", interrupted)
    with pytest.raises(KeyboardInterrupt):
        write_whole(target, "new")
    assert target.read_text() == "old"
    assert [path.name for path in tmp_path.iterdir()] == ["a.txt"]


def test_a_full_disk_is_one_line(tmp_path, monkeypatch):
    def full(descriptor):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OutputError, match="No space left") as caught:
        write_whole(tmp_path / "a.txt", "new")
    assert "\n" not in str(caught.value)
    assert list(tmp_path.iterdir()) == []


def test_follows_links_and_keeps_modes(tmp_path):
    target = tmp_path / "real.txt"
    target.write_text("old")
    target.chmod(0o640)
    (tmp_path / "link.txt").symlink_to(target)
    write_whole(tmp_path / "link.txt", "new")
    assert (tmp_path / "link.txt").is_symlink()
    assert target.read_text() == "new"
    assert stat.S_IMODE(target.stat().st_mode) == 0o640


def test_new_files_follow_the_umask(tmp_path):
    before = os.umask(0o027)
    try:
        write_whole(tmp_path / "a.txt", "x")
    finally:
        os.umask(before)
    assert stat.S_IMODE((tmp_path / "a.txt").stat().st_mode) == 0o640


def test_writes_straight_to_a_device():
    write_whole("/dev/null", "x")
    assert stat.S_ISCHR(Path("/dev/null").stat().st_mode)


def test_several_files_may_go_to_pipes(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    reader = os.open(tmp_path / "pipe", os.O_RDONLY | os.O_NONBLOCK)
    try:
        write_together({tmp_path / "pipe": "x", tmp_path / "a.txt": "y"})
        assert os.read(reader, 9) == b"x"
    finally:
        os.close(reader)
    assert stat.S_ISFIFO((tmp_path / "pipe").stat().st_mode)
    assert (tmp_path / "a.txt").read_text() == "y"


@pytest.mark.parametrize(("name", "problem"), [("", "is a folder"), ("no/such/a.txt", "does not exist")])
def test_says_why_it_cannot_write(tmp_path, name, problem):
    with pytest.raises(OutputError, match=problem) as caught:
        write_whole(tmp_path / name, "x")
    assert isinstance(caught.value, BadInputError)
    assert caught.value.exit_code == 2
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("error", [OSError(28, "No space left on device"), KeyboardInterrupt()])
def test_several_files_are_written_all_or_none(tmp_path, monkeypatch, error):
    (tmp_path / "old.txt").write_text("old")
    files = {tmp_path / "old.txt": "new", tmp_path / "a" / "b" / "c.txt": b"c", tmp_path / "d.txt": "d"}
    before = sorted(tmp_path.rglob("*"))
    calls = []

    def fails_once_at_the_third(descriptor):
        calls.append(descriptor)
        if len(calls) == 3:
            raise error

    with monkeypatch.context() as patched:
        patched.setattr(os, "fsync", fails_once_at_the_third)
        with pytest.raises(OutputError if isinstance(error, OSError) else KeyboardInterrupt):
            write_together(files)
    assert len(calls) == 3  # nothing was put in place yet
    assert (tmp_path / "old.txt").read_text() == "old"
    assert sorted(tmp_path.rglob("*")) == before
    assert write_together(files) == list(files)
    assert (tmp_path / "old.txt").read_text() == "new"
    assert (tmp_path / "a" / "b" / "c.txt").read_text() == "c"


def test_files_that_were_put_in_place_are_taken_back(tmp_path, monkeypatch):
    old, new = tmp_path / "old.txt", tmp_path / "new.txt"
    old.write_text("old")
    put, place = [], Path.replace

    def fails_at_the_third(self, target):
        put.append(target)
        if len(put) == 3:
            raise KeyboardInterrupt
        return place(self, target)

    with monkeypatch.context() as patched:
        patched.setattr(Path, "replace", fails_at_the_third)
        with pytest.raises(KeyboardInterrupt):
            write_together({old: "1", new: "2", tmp_path / "third.txt": "3"})
    assert old.read_text() == "old"
    assert [path.name for path in tmp_path.iterdir()] == ["old.txt"]


@pytest.mark.parametrize("error", [PermissionError(13, "Permission denied"), KeyboardInterrupt()])
def test_files_of_an_earlier_answer_go_with_it_or_stay_with_it(tmp_path, monkeypatch, error):
    one, other, never = (tmp_path / name for name in ("one.txt", "other.txt", "never.txt"))
    unlink = Path.unlink
    write_together({one: "old", other: "old"})

    def fails(self, missing_ok=False):
        if self == other:
            raise error
        unlink(self, missing_ok)

    with monkeypatch.context() as patched:
        patched.setattr(Path, "unlink", fails)
        with pytest.raises((OutputError, KeyboardInterrupt)):
            write_together({one: "new"}, earlier=[one, other, never])
    assert [path.read_text() for path in (one, other)] == ["old", "old"]
    with pytest.raises(OutputError, match=r"other\.txt: it exists already"):
        write_together({tmp_path / "new.txt": "new"}, overwrite=False, earlier=[other, never])
    assert write_together({one: "new"}, earlier=[one, other, never]) == [one]
    assert [path.name for path in tmp_path.iterdir()] == ["one.txt"]


def test_a_new_folder_appears_with_all_its_files_or_not_at_all(tmp_path, monkeypatch):
    """At no moment, not even that of a kill, is a part of them seen."""
    seen, write = [], os.fsync

    def look(descriptor):
        seen.append([path.name for path in tmp_path.iterdir() if not path.name.startswith(".")])
        write(descriptor)

    monkeypatch.setattr(os, "fsync", look)
    files = {tmp_path / "new" / "a.txt": "a", tmp_path / "new" / "deep" / "b.txt": b"b"}
    assert write_together(files) == list(files)
    assert seen == [[], []]
    assert [path.name for path in tmp_path.iterdir()] == ["new"]
    assert (tmp_path / "new" / "deep" / "b.txt").read_bytes() == b"b"


def test_a_folder_that_another_run_made_meanwhile_is_left_alone(tmp_path, monkeypatch):
    def another_run(descriptor):
        (tmp_path / "new").mkdir(exist_ok=True)
        (tmp_path / "new" / "a.txt").write_text("theirs")

    monkeypatch.setattr(os, "fsync", another_run)
    with pytest.raises(OutputError, match="another run has created it meanwhile"):
        write_together({tmp_path / "new" / "a.txt": "ours"})
    assert [path.name for path in tmp_path.iterdir()] == ["new"]
    assert (tmp_path / "new" / "a.txt").read_text() == "theirs"


@pytest.mark.parametrize("letter", ["a", "\u00e9", "\U0001f525"])
def test_names_may_be_as_long_as_the_file_system_takes_them(tmp_path, letter):
    path = tmp_path / (letter * (255 // len(letter.encode())))
    write_whole(path, "x")
    assert path.read_text() == "x"


def test_a_way_that_leads_back_out_of_a_missing_folder_is_none(tmp_path):
    with pytest.raises(OutputError):
        write_together({tmp_path / "new" / ".." / "other" / "a.txt": "a"})
    assert not list(tmp_path.iterdir())


def test_a_file_in_the_place_of_a_folder_is_told(tmp_path):
    (tmp_path / "file").write_text("x")
    for check in (check_folder, check_writable):
        with pytest.raises(OutputError, match=r"/file is a file; give a folder$"):
            check(tmp_path / "file" / "sub")


def test_outputs_are_checked_before_the_work(tmp_path):
    (tmp_path / "there").write_text("x")
    check_outputs([tmp_path / "there", tmp_path / "new"])
    with pytest.raises(OutputError, match="exists already"):
        check_outputs([tmp_path / "there"], overwrite=False)
    with pytest.raises(OutputError, match="same file name"):
        check_outputs([tmp_path / "a", tmp_path / "a"])


def test_a_folder_that_cannot_be_made_is_one_line(tmp_path):
    (tmp_path / "file").write_text("x")
    with pytest.raises(OutputError) as caught:
        write_together({tmp_path / "first" / "a.txt": "a", tmp_path / "file" / "folder" / "b.txt": "b"})
    assert "\n" not in str(caught.value)
    assert [path.name for path in tmp_path.rglob("*")] == ["file"]


def test_a_new_folder_is_one_however_it_is_spelled(tmp_path, monkeypatch):
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    write_together({Path("new/a.txt"): "a", Path("../here/new/b.txt"): "b", tmp_path / "here" / "new" / "c.txt": "c"})
    assert sorted(path.name for path in Path("new").iterdir()) == ["a.txt", "b.txt", "c.txt"]


def test_what_was_there_comes_back_though_something_new_is_gone(tmp_path, monkeypatch):
    new, old = tmp_path / "new.txt", tmp_path / "old.txt"
    old.write_text("old")

    def failing(given, content):
        if given == pipe:
            new.unlink()
            raise OutputError(given, "full")
        return put(given, content)

    pipe, put = tmp_path / "pipe", files._put
    os.mkfifo(pipe)
    monkeypatch.setattr(files, "_put", failing)
    with pytest.raises(OutputError, match="full"):
        write_together({new: "new", old: "other", pipe: "x"})
    assert old.read_text() == "old" and not new.exists()
