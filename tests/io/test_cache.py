"""The cache between runs: made once, and never an obstacle."""

from concurrent.futures import ThreadPoolExecutor

import pytest

from pouring_robot.exceptions import BadInputError
from pouring_robot.io.cache import CACHE_VARIABLE, cache_folder, content_key, kept_text


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path / "kept"))
    return tmp_path / "kept"


def test_a_text_is_made_once(folder):
    assert kept_text("a/b.txt", lambda: "µ") == "µ"
    assert kept_text("a/b.txt", lambda: "other") == "µ"
    assert [path.name for path in (folder / "a").iterdir()] == ["b.txt"]


def test_what_fails_is_not_kept(folder):
    def fail():
        raise BadInputError("no")

    with pytest.raises(BadInputError):
        kept_text("b.txt", fail)
    assert kept_text("b.txt", lambda: "yes") == "yes"


@pytest.mark.parametrize("content", [b"a file where the folder should be", None])
def test_a_place_that_cannot_be_written_to_is_no_trouble(folder, content):
    if content is None:
        (folder / "c.txt").mkdir(parents=True)  # not even root can write over a folder
    else:
        folder.write_bytes(content)
    assert kept_text("c.txt", lambda: "one") == "one"
    assert kept_text("c.txt", lambda: "two") == "two"


@pytest.mark.parametrize("damage", [lambda _: b"\xff\xfe", lambda _: b"", lambda kept: kept[:-1] + b"n"])
def test_a_damaged_file_is_made_again(folder, damage):
    kept_text("d.txt", lambda: "sound")
    (folder / "d.txt").write_bytes(damage((folder / "d.txt").read_bytes()))
    assert kept_text("d.txt", lambda: "sound") == kept_text("d.txt", lambda: "other") == "sound"


def test_many_at_once_read_whole_texts(folder):
    text = "0123456789" * 100_000
    with ThreadPoolExecutor(8) as pool:
        assert set(pool.map(lambda _: kept_text("e.txt", lambda: text), range(64))) == {text}


def test_a_user_without_a_home_keeps_nothing(monkeypatch):
    monkeypatch.delenv(CACHE_VARIABLE, raising=False)
    monkeypatch.setattr("platformdirs.user_cache_dir", lambda *_, **__: "~/.cache/pouring_robot")
    assert cache_folder() is None
    assert kept_text("f.txt", lambda: "text") == "text"


def test_a_key_tells_where_one_part_ends():
    assert content_key(["ab", "c"]) != content_key(["a", "bc"])
    assert content_key(["ab", b"c"]) == content_key([b"ab", "c"])
