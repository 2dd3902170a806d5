"""`mjbench results merge`: every run once, to the byte; nothing else in a set ever changes."""

import json
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner, Result
from commands import PYTHONPATH, ROOT
from example_records import measurement, model_record
from set_files import MACHINE, labelled, run_file, section_of, set_of

from mjbench.cli import cli
from mjbench.report.kinds import RECORD_TYPES
from mjbench.store import run_set
from mjbench.store.run_set import RunSetFile


def merge(*arguments: str | Path) -> Result:
    return CliRunner().invoke(cli, ["results", "merge", *map(str, arguments)])


def stored(folder: Path, name: str, models: str = "m") -> Path:
    """Return a run file of a machine, with a record for each letter of `models`."""
    return run_file(folder / name, labelled(name), *(model_record(model=m) for m in models))


@pytest.fixture(autouse=True)
def in_its_own_folder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.chdir(tmp_path)


def contents(path: Path | str) -> list[bytes]:
    """Return the lines of each section of a set, joined."""
    return [b"".join(s.lines) for s in run_set.read(Path(path), RECORD_TYPES).sections]


# what is merged


def test_a_name_that_no_file_can_have_is_one_line(tmp_path: Path) -> None:
    done = merge(stored(tmp_path, "a"), "-o", "x" * 300)
    assert done.exit_code and "cannot write xxx" in done.output
    assert "File name too long" in done.output and "details in" not in done.output


def test_run_files_and_sets_become_one_set(tmp_path: Path) -> None:
    a, b, c = (stored(tmp_path, name) for name in "abc")
    inner = set_of(tmp_path / "inner.jsonl", [b, c])
    done = merge(a, inner, "-o", "all.jsonl", "--json", "out.json")
    assert done.exit_code == 0, done.output
    assert done.output == "all.jsonl: 3 runs of 3 machines; added 3\n"
    document = json.loads(Path("out.json").read_text())
    assert (document["runs"], document["machines"], document["added"]) == (3, 3, 3)
    refused = merge(a, "-o", "all.jsonl", "--json", "all.jsonl")
    assert refused.exit_code == 2
    assert contents("all.jsonl") == [path.read_bytes() for path in (a, b, c)]


def test_a_run_that_is_given_twice_is_there_once(tmp_path: Path) -> None:
    a, b = (stored(tmp_path, name) for name in "ab")
    copy = Path(shutil.copy(a, tmp_path / "copy.jsonl"))
    done = merge(a, copy, set_of(tmp_path / "inner.jsonl", [a, b]), "-o", "all.jsonl")
    assert "2 runs of 2 machines; added 2, skipped 2 that it already holds" in done.output
    assert contents("all.jsonl") == [a.read_bytes(), b.read_bytes()]


def test_new_runs_are_appended_to_a_set_and_nothing_else_changes(tmp_path: Path) -> None:
    a, b = (stored(tmp_path, name) for name in "ab")
    merge(a, "-o", "all.jsonl")
    before = Path("all.jsonl").read_bytes()
    done = merge(a, b, "-o", "all.jsonl")
    assert "added 1, skipped 1 that it already holds" in done.output
    assert Path("all.jsonl").read_bytes().startswith(before)
    after = Path("all.jsonl").read_bytes()
    # also with itself as an input
    assert "added 0, skipped 2" in merge("all.jsonl", "-o", "all.jsonl").output
    assert Path("all.jsonl").read_bytes() == after


def test_an_earlier_state_of_a_run_is_skipped_or_replaced_by_the_later_one(tmp_path: Path) -> None:
    late = stored(tmp_path, "a", "mno")
    early = tmp_path / "early.jsonl"
    early.write_bytes(b"".join(late.read_bytes().splitlines(keepends=True)[:-1]))
    done = merge(early, late, "-o", "all.jsonl")
    assert "1 run of 1 machine; added 1, skipped 1 of which it holds a later state" in done.output
    assert contents("all.jsonl") == [late.read_bytes()]
    merge(early, "-o", "nightly.jsonl")
    assert "1 run of 1 machine; added 1\n" in merge(late, "-o", "nightly.jsonl").output
    assert contents("nightly.jsonl") == [early.read_bytes(), late.read_bytes()]


def test_cells_of_a_sweep_keep_their_names(tmp_path: Path) -> None:
    file = RunSetFile.create(tmp_path / "sweep.jsonl")
    file.append(section_of(stored(tmp_path, "a"), cell="cell 1"))
    file.close()
    merge("sweep.jsonl", "-o", "all.jsonl")
    assert run_set.read(Path("all.jsonl"), RECORD_TYPES).sections[0].cell == "cell 1"


def test_machines_are_counted_by_what_tells_them_apart(tmp_path: Path) -> None:
    machines = [MACHINE, labelled("", host="a1"), labelled("", host="b2"), labelled("lab")]
    files = [
        run_file(tmp_path / str(n), machine, model_record())
        for n, machine in enumerate([*machines, *machines])
    ]
    done = merge(*files, "-o", "all.jsonl")
    # of two runs that do not differ in a byte, one is left out
    assert "4 runs of 4 machines; added 4, skipped 4 that it already holds" in done.output


def test_a_committed_run_is_kept_to_the_byte() -> None:
    run = ROOT / "results/runs/reference-mujoco-4.0.0.jsonl"
    assert merge(run, "-o", "all.jsonl").exit_code == 0
    assert contents("all.jsonl") == [run.read_bytes()]


# what is damaged


def test_an_end_that_was_cut_short_is_left_out_and_named(tmp_path: Path) -> None:
    a, b = (stored(tmp_path, name, "mn") for name in "ab")
    b.write_bytes(b.read_bytes()[:-9])
    torn = set_of(tmp_path / "torn.jsonl", [a])
    torn.write_bytes(torn.read_bytes() + b'{"type": "section", "lines": 3, "sha256": "0"}\n{"')
    done = merge(b, torn, "-o", "all.jsonl")
    assert done.exit_code == 0
    for name in (b, torn):
        assert f"{name}: its end was cut short; the incomplete part is left out" in done.output
    assert [len(c.splitlines()) for c in contents("all.jsonl")] == [2, 3]


def test_a_set_whose_writer_was_killed_is_continued(tmp_path: Path) -> None:
    a, b = (stored(tmp_path, name) for name in "ab")
    merge(a, b, "-o", "all.jsonl")
    whole = Path("all.jsonl").read_bytes()
    Path("all.jsonl").write_bytes(whole[:-20])
    assert "added 1, skipped 1" in merge(a, b, "-o", "all.jsonl").output
    assert Path("all.jsonl").read_bytes() == whole


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "bad.jsonl: not a run file"),
        ("tea", "bad.jsonl, line 1: not JSON"),
        ('{"type": "set", "schema": 2}\n', "bad.jsonl: format 2"),
        ('{"type": "set", "schema": 1}\n{"type": "run"}\n', "bad.jsonl, line 2: not the first"),
    ],
)
def test_bad_input_is_refused_in_a_line_and_nothing_is_written(
    tmp_path: Path, text: str, message: str
) -> None:
    Path("bad.jsonl").write_text(text)
    done = merge(stored(tmp_path, "a"), "bad.jsonl", "-o", "all.jsonl")
    assert done.exit_code == 2
    assert message in done.stderr
    assert done.stderr.count("\n") == 1
    assert not Path("all.jsonl").exists()


def test_a_section_that_was_edited_is_refused_with_its_line(tmp_path: Path) -> None:
    merge(stored(tmp_path, "a"), stored(tmp_path, "b"), "-o", "all.jsonl")
    edited = Path("all.jsonl").read_text().replace('"model": "m"', '"model": "x"')
    Path("all.jsonl").write_text(edited)
    for arguments in (["all.jsonl", "-o", "new.jsonl"], [stored(tmp_path, "c"), "-o", "all.jsonl"]):
        done = merge(*arguments)
        assert done.exit_code == 2
        assert "all.jsonl, line 2: the section is not as it was written" in done.stderr
    assert Path("all.jsonl").read_text() == edited
    assert not Path("new.jsonl").exists()


# what is no output


def test_a_run_file_is_no_output_whether_it_is_an_input_or_not(tmp_path: Path) -> None:
    a, b = (stored(tmp_path, name) for name in "ab")
    before = a.read_bytes()
    for inputs in ([a, b], [b]):
        done = merge(*inputs, "-o", a)
        assert done.exit_code == 2
        assert "not a run set" in done.stderr
    assert a.read_bytes() == before


@pytest.mark.parametrize(
    ("output", "code", "message"),
    [
        ("-", 2, "give -o FILE"),
        ("missing/all.jsonl", 3, "No such file or directory"),
        (".", 3, "Is a directory"),
        ("/proc/all.jsonl", 3, "cannot write /proc/all.jsonl"),
        ("pipe", 2, "pipe: not a file"),
        ("/dev/null", 2, "/dev/null: not a file"),
        ("notes.txt", 2, "notes.txt: not a run set"),
    ],
)
def test_what_cannot_be_written_ends_in_a_line(
    tmp_path: Path, output: str, code: int, message: str
) -> None:
    os.mkfifo("pipe")
    Path("notes.txt").write_text("tea\n")
    done = merge(stored(tmp_path, "a"), "-o", output)
    assert (done.exit_code, done.stderr.count("\n")) == (code, 1), done.output
    assert message in done.stderr


def test_a_set_that_another_process_writes_is_left_alone(tmp_path: Path) -> None:
    file = RunSetFile.create(tmp_path / "all.jsonl")
    before = file.path.read_bytes()
    done = merge(stored(tmp_path, "a"), "-o", "all.jsonl")
    assert done.exit_code == 3
    assert "another mjbench is writing it" in done.stderr
    assert file.path.read_bytes() == before
    file.close()


def test_an_empty_file_becomes_a_set(tmp_path: Path) -> None:
    Path("all.jsonl").touch()
    assert "added 1" in merge(stored(tmp_path, "a"), "-o", "all.jsonl").output


# a writer that is killed


APPEND_FOREVER = """
import sys
from pathlib import Path
from mjbench.store import run_set
from mjbench.store.run_set import RunSetFile
from mjbench.report.kinds import RECORD_TYPES

(section,) = run_set.read(Path(sys.argv[1]), RECORD_TYPES).sections
file = RunSetFile.create(Path("all.jsonl"))
print("begins", flush=True)
while True:
    file.append(section)
"""


def test_what_a_killed_writer_leaves_is_read_and_continued(tmp_path: Path) -> None:
    records = [measurement(samples_s=[0.1 + i * 1e-9 for i in range(20_000)]) for _ in range(3)]
    run = run_file(tmp_path / "runs", labelled("killed"), model_record(), *records)
    writer = subprocess.Popen(
        [sys.executable, "-c", APPEND_FOREVER, str(run)],
        env={**os.environ, "PYTHONPATH": PYTHONPATH},
        stdout=subprocess.PIPE,
    )
    assert writer.stdout is not None
    writer.stdout.readline()
    while Path("all.jsonl").stat().st_size < 3 * run.stat().st_size:
        assert writer.poll() is None
    os.kill(writer.pid, signal.SIGKILL)
    writer.wait()
    writer.stdout.close()
    read = run_set.read(Path("all.jsonl"), RECORD_TYPES)
    assert len(read.sections) >= 2
    assert {b"".join(section.lines) for section in read.sections} == {run.read_bytes()}
    done = merge(stored(tmp_path, "a"), "-o", "all.jsonl")
    assert "2 runs of 2 machines; added 1" in done.output
    assert not run_set.read(Path("all.jsonl"), RECORD_TYPES).is_torn
