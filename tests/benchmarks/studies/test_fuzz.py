"""The fuzz draws what it says, and notices an end that is not well."""

import itertools
from pathlib import Path

import pytest

from benchmarks.studies import fuzz
from mjbench.cli import cli
from mjbench.commands.shared_options import OUTPUT_FILE


def test_the_same_seed_draws_the_same_command_lines_of_every_command() -> None:
    lines = [list(itertools.islice(fuzz.command_lines(seed=1), 500)) for _ in range(2)]
    assert lines[0] == lines[1]
    drawn = {words for line in lines[0] for words in (line[0], " ".join(line[:2]))}
    assert set(cli.commands) - {"results", "releases"} <= drawn


def test_options_that_are_kept_short_or_left_out_are_options_of_commands() -> None:
    flags = {name for _, command in fuzz.leaves(cli, ()) for p in command.params for name in p.opts}
    assert {*fuzz.SHORT, *fuzz.NEVER} <= flags


def test_options_that_name_a_file_to_write_are_known() -> None:
    options = (each for _, command in fuzz.leaves(cli, ()) for each in command.params)
    written = [each.opts[0] for each in options if each.make_metavar(None) == OUTPUT_FILE.metavar]
    assert set(written) == set(fuzz.OUTPUT_FLAGS)


@pytest.mark.parametrize(
    ("code", "out", "err", "problem"),
    [
        (0, "table\n", "", ""),
        (2, "", "mjbench: no such file\n", ""),
        (0, "", "", ""),
        (2, "", "", "exit code 2 without a word"),
        (-11, "", "", "exit code -11"),
        (130, "", "x", "exit code 130"),
        (1, "", "Traceback (most recent call last):\n", "a traceback"),
        (3, "", "mjbench: unexpected KeyError: 'x'\n", "an unforeseen error"),
        (2, "", "mjbench: no model \x1b[2J\n", "a control character"),
    ],
)
def test_an_end_that_is_not_well_is_named(code: int, out: str, err: str, problem: str) -> None:
    assert fuzz.judge(code, out, err) == problem


def test_a_command_that_is_bad_usage_ends_well() -> None:
    assert fuzz.run(("lint", "nowhere.py")) == (2, None)


def test_a_file_that_changed_is_noticed(tmp_path: Path) -> None:
    fuzz.prepare(tmp_path)
    before = fuzz.digests(tmp_path)
    assert before == fuzz.digests(tmp_path)
    (tmp_path / "good.xml").write_text("")
    assert before != fuzz.digests(tmp_path)
