"""Two that measure at once: each hears of the other; one that waits begins when the other ends."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from mjbench.host import neighbours, platforms
from mjbench.host.neighbours import Neighbour, Presence

ME = os.getpid()


def test_one_alone_hears_of_nobody(tmp_path: Path) -> None:
    with Presence("compare", tmp_path) as alone:
        assert alone.enter(wait=False) == []
        assert alone.later_neighbours() == []


def test_each_of_two_hears_of_the_other(tmp_path: Path) -> None:
    with Presence("compare", tmp_path) as first, Presence("versions", tmp_path) as second:
        first.enter(wait=False)
        assert second.enter(wait=False) == [Neighbour(ME, "compare")]
        assert first.later_neighbours() == [Neighbour(ME, "versions")]
        assert second.later_neighbours() == []


def test_who_only_looks_is_not_heard_of(tmp_path: Path) -> None:
    assert neighbours.measuring_now(tmp_path) == []
    with Presence("compare", tmp_path) as first:
        first.enter(wait=False)
        assert neighbours.measuring_now(tmp_path) == [Neighbour(ME, "compare")]
        assert first.later_neighbours() == []
    assert neighbours.measuring_now(tmp_path) == []


def test_who_cannot_look_sees_nobody(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    assert neighbours.measuring_now(tmp_path / "file") == []


def test_one_that_waits_begins_when_the_other_has_ended(tmp_path: Path) -> None:
    events: list[object] = []
    with Presence("ab", tmp_path) as waiting:
        with Presence("compare", tmp_path) as first:
            first.enter(wait=False)

            def sleep(seconds: float) -> None:
                events.append("sleep")
                if len(events) == 3:
                    first.__exit__()

            assert waiting.enter(True, events.append, sleep) == []
        assert events == [[Neighbour(ME, "compare")], "sleep", "sleep"]


def test_one_that_was_killed_is_forgotten(tmp_path: Path) -> None:
    code = (
        "import os, sys; from pathlib import Path\n"
        "from mjbench.host.neighbours import Presence\n"
        "Presence('compare', Path(sys.argv[1])).__enter__().enter(wait=False); os._exit(1)"
    )
    subprocess.run([sys.executable, "-c", code, tmp_path], check=False)
    assert list(tmp_path.glob("*.json"))
    with Presence("versions", tmp_path) as second:
        assert second.enter(wait=True) == []
        assert len(list(tmp_path.glob("*.json"))) == 1
    assert not list(tmp_path.glob("*.json"))


@pytest.mark.parametrize(
    "text", ["", "x", "{}", "[1]", '{"pid": "x"}', '{"pid": Infinity, "command": ""}', "[" * 1_500]
)
def test_a_file_that_says_nothing_is_still_a_neighbour(tmp_path: Path, text: str) -> None:
    with Presence("compare", tmp_path) as first, Presence("ab", tmp_path) as second:
        first.enter(wait=False)
        (file,) = tmp_path.glob("*.json")
        file.write_text(f"{text}\n{text}\n")
        assert len(second.enter(wait=False)) == 1
        assert first.later_neighbours() == [Neighbour(ME, "ab")]


def test_a_folder_that_cannot_be_used_notices_nobody(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with Presence("compare", tmp_path / "file") as alone:
        assert alone.enter(wait=True) == []
        assert alone.later_neighbours() == []


def test_the_folder_is_shared_by_all_users(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.delenv(neighbours.FOLDER_VARIABLE)
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    assert tmp_path not in neighbours.shared_folder().parents
    monkeypatch.setenv(neighbours.FOLDER_VARIABLE, str(tmp_path))
    assert neighbours.shared_folder().parent == tmp_path
    with Presence("compare", tmp_path / "new") as alone:
        alone.enter(wait=False)
        assert (tmp_path / "new").stat().st_mode & 0o7777 == 0o1777
        assert {file.stat().st_mode & 0o777 for file in (tmp_path / "new").iterdir()} == {0o666}


def test_foreign_files_are_left_alone_and_do_not_hang(tmp_path: Path) -> None:
    (tmp_path / "results.json").write_text("{}")
    (tmp_path / "1-2.json").symlink_to(tmp_path / "results.json")
    os.mkfifo(tmp_path / "3-4.json")
    (tmp_path / "5-6.json").mkdir()
    with Presence("compare", tmp_path) as alone:
        assert alone.enter(wait=True) == []
    names = {"1-2.json", "3-4.json", "5-6.json", "results.json", "entry"}
    assert {file.name for file in tmp_path.iterdir()} == names
    assert (tmp_path / "results.json").read_text() == "{}"


def test_a_link_in_place_of_the_folder_is_not_followed(tmp_path: Path) -> None:
    (tmp_path / "home").mkdir()
    (tmp_path / "link").symlink_to("home")
    with Presence("compare", tmp_path / "link") as alone:
        assert alone.enter(wait=False) == []
    assert list((tmp_path / "home").iterdir()) == []


def test_a_turn_that_never_ends_is_not_awaited_for_long(tmp_path: Path) -> None:
    slept: list[float] = []
    with Presence("compare", tmp_path) as first, Presence("ab", tmp_path) as second:
        first.enter(wait=False)
        with (tmp_path / "entry").open() as turn:
            platforms.lock_file(turn.fileno(), shared=False, wait=False)
            assert second.enter(True, sleep=slept.append) == []
    assert 1 < sum(slept) < 10
