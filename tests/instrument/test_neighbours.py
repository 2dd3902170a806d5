"""Two that measure at once: each hears of the other; one that waits begins when the other ends."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from mjbench.instrument import neighbours
from mjbench.instrument.neighbours import Neighbour, Presence

ME = os.getpid()


def test_one_alone_hears_of_nobody(tmp_path: Path) -> None:
    with Presence("compare", tmp_path) as alone:
        assert alone.enter(wait=False) == []
        assert alone.arrivals() == []


def test_each_of_two_hears_of_the_other(tmp_path: Path) -> None:
    with Presence("compare", tmp_path) as first, Presence("versions", tmp_path) as second:
        first.enter(wait=False)
        assert second.enter(wait=False) == [Neighbour(ME, "compare")]
        assert first.arrivals() == [Neighbour(ME, "versions")]
        assert second.arrivals() == []


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
        "from mjbench.instrument.neighbours import Presence\n"
        "Presence('compare', Path(sys.argv[1])).__enter__().enter(wait=False); os._exit(1)"
    )
    subprocess.run([sys.executable, "-c", code, tmp_path], check=False)
    assert list(tmp_path.glob("*.json"))
    with Presence("versions", tmp_path) as second:
        assert second.enter(wait=True) == []
        assert len(list(tmp_path.glob("*.json"))) == 1
    assert not list(tmp_path.glob("*.json"))


@pytest.mark.parametrize("text", ["", "x", "{}", "[1]", '{"pid": "x", "command": 1}'])
def test_a_file_that_says_nothing_is_still_a_neighbour(tmp_path: Path, text: str) -> None:
    with Presence("compare", tmp_path) as first, Presence("ab", tmp_path) as second:
        first.enter(wait=False)
        (file,) = tmp_path.glob("*.json")
        file.write_text(f"{text}\n{text}\n")
        assert len(second.enter(wait=False)) == 1
        assert first.arrivals() == [Neighbour(ME, "ab")]


def test_a_folder_that_cannot_be_used_notices_nobody(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with Presence("compare", tmp_path / "file") as alone:
        assert alone.enter(wait=True) == []
        assert alone.arrivals() == []


def test_the_folder_is_shared_by_all_users(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.delenv(neighbours.FOLDER_VARIABLE)
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    assert tmp_path not in neighbours.shared_folder().parents
    with Presence("compare", tmp_path / "new") as alone:
        alone.enter(wait=False)
        assert (tmp_path / "new").stat().st_mode & 0o7777 == 0o1777
        assert {file.stat().st_mode & 0o777 for file in (tmp_path / "new").iterdir()} == {0o666}
