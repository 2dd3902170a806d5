"""Run files that somebody damaged: `show` prints them, or refuse them in one line."""

import copy
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import filled_records
import pytest
from click.testing import CliRunner
from hypothesis import given, settings
from hypothesis import strategies as st

from mjbench.cli import cli

FOREIGN: list[Any] = [
    None, True, 0, -1, 1, 10**30, -0.0, 1e-320, 1e308, -1e308, "", "x", "NaN", "a\x1b]52;\nb",
    "ok", "python_loop", "mjx", [], [0.0], [-1.0], [1e-320, 1e308], [[]], {}, {"a": [{}]},
    [None], "x" * 5_000,
]  # fmt: skip


LINES = {command: filled_records.lines(command) for command in filled_records.KINDS}


def places(value: Any, place: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Yield where every value inside a JSON value is."""
    items = value.items() if isinstance(value, dict) else ()
    items = enumerate(value) if isinstance(value, list) else items
    for key, item in items:
        yield (*place, key)
        yield from places(item, (*place, key))


def replacements(value: Any) -> list[Any]:
    """Return what may stand for a value: more often than not, something of its type."""
    alike = [x for x in FOREIGN if type(x) is type(value)]
    if isinstance(value, int | float):
        alike = [x for x in FOREIGN if isinstance(x, int | float)]
    return [*alike, *alike, *alike, *FOREIGN]


@st.composite
def damaged_lines(draw: st.DrawFn) -> str:
    """Return the text of a run file in which one to three values are others, or missing."""
    lines = json.loads(json.dumps(LINES[draw(st.sampled_from(sorted(LINES)))]))
    for _ in range(draw(st.integers(1, 3))):
        *path, key = draw(st.sampled_from(list(places(lines))))
        holder = lines
        for step in path:
            holder = holder[step]
        if isinstance(holder, dict) and draw(st.booleans()) and draw(st.booleans()):
            del holder[key]
        else:
            holder[key] = copy.deepcopy(draw(st.sampled_from(replacements(holder[key]))))
    return "".join(json.dumps(line) + "\n" for line in lines)


def check_ends_well(*words: str) -> None:
    """Run a command; it ends with a table, or with one line that says what is wrong."""
    done = CliRunner().invoke(cli, words)
    assert done.exit_code in (0, 1, 2), (done.exit_code, done.stderr)
    assert "unexpected" not in done.stderr, done.stderr
    assert "\x1b" not in done.output
    assert done.stderr.count("\n") <= 1, done.stderr
    assert done.output


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("runs")
    whole = [json.dumps(line) + "\n" for line in LINES["compare"]]
    (folder / "whole.jsonl").write_text("".join(whole))
    return folder


@settings(max_examples=150, deadline=None)
@given(text=damaged_lines())
def test_a_run_file_with_other_values_is_shown_or_refused(folder: Path, text: str) -> None:
    (folder / "damaged.jsonl").write_text(text)
    check_ends_well("show", str(folder / "damaged.jsonl"), "--json", str(folder / "out.json"))
    check_ends_well("show", str(folder / "damaged.jsonl"), str(folder / "whole.jsonl"))


@settings(max_examples=50, deadline=None)
@given(cut=st.floats(0, 1), at=st.floats(0, 1), inserted=st.binary(max_size=8))
def test_a_run_file_of_other_bytes_is_shown_or_refused(
    folder: Path, cut: float, at: float, inserted: bytes
) -> None:
    content = (folder / "whole.jsonl").read_bytes()
    place = int(at * len(content))
    content = content[:place] + inserted + content[place + len(inserted) :]
    (folder / "damaged.jsonl").write_bytes(content[: int(cut * len(content))])
    check_ends_well("show", str(folder / "damaged.jsonl"))


@pytest.mark.parametrize("command", LINES)
def test_an_undamaged_run_file_is_shown(folder: Path, command: str) -> None:
    (folder / "sound.jsonl").write_text("".join(json.dumps(x) + "\n" for x in LINES[command]))
    assert CliRunner().invoke(cli, ["show", str(folder / "sound.jsonl")]).exit_code == 0
