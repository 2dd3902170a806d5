import errno
import json
import os
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import pytest

from mjbench.errors import InputError, MachineError
from mjbench.host import machine
from mjbench.results import run_writer, runs


@dataclass(frozen=True)
class Sample:
    """A record with a number and a unit that may be missing."""

    record_type: ClassVar[str] = "sample"
    index: int
    seconds: float = 0.0


@dataclass(frozen=True)
class Note:
    """A record of another type."""

    record_type: ClassVar[str] = "note"
    text: str


@dataclass(frozen=True)
class Arguments:
    """Arguments of a command, one of which is a path."""

    model: str
    results: Path


TYPES = {kind.record_type: kind for kind in (Sample, Note)}
MACHINE = machine.describe()
ARGUMENTS = Arguments("cartpole", Path("runs"))
HEADER = runs.RunHeader(runs.SCHEMA, "compare", MACHINE, runs.to_json(ARGUMENTS))
RECORDS = (Sample(1, 0.5), Note("between"), Sample(2))


def written(folder: Path) -> Path:
    """Return a run file with RECORDS."""
    file = run_writer.RunFile.create(folder, HEADER)
    for record in RECORDS:
        file.append(record)
    file.close()
    return file.path


def edited(folder: Path, number: int, line: str) -> Path:
    """Return a run file whose line `number`, counted from 1, is another."""
    path = written(folder)
    lines = path.read_text().splitlines()
    lines[number - 1] = line
    path.write_text("".join(f"{text}\n" for text in lines))
    return path


# what comes back


def test_records_come_back_in_order_as_what_they_were(tmp_path: Path) -> None:
    assert runs.load(written(tmp_path), TYPES).records == RECORDS


def test_records_are_selected_by_type(tmp_path: Path) -> None:
    run = runs.load(written(tmp_path), TYPES)
    assert run.of_type(Sample) == [RECORDS[0], RECORDS[2]]
    assert run.of_type(Note) == [RECORDS[1]]
    assert run.of_type(runs.RunHeader) == []


def test_the_header_holds_the_machine_and_the_arguments(tmp_path: Path) -> None:
    header = runs.load(written(tmp_path), TYPES).header
    assert header == runs.RunHeader(
        runs.SCHEMA, "compare", MACHINE, {"model": "cartpole", "results": "runs"}
    )


def test_every_record_is_on_disk_as_soon_as_it_is_appended(tmp_path: Path) -> None:
    file = run_writer.RunFile.create(tmp_path, HEADER)
    file.append(Sample(1))
    last_line = file.path.read_text().splitlines()[-1]
    assert json.loads(last_line) == {"type": "sample", "index": 1, "seconds": 0.0}
    file.close()


def test_a_key_that_a_later_version_added_is_ignored(tmp_path: Path) -> None:
    path = edited(tmp_path, 2, '{"type": "sample", "index": 7, "added": [1]}')
    assert runs.load(path, TYPES).records[0] == Sample(7)


def test_a_last_line_cut_short_loses_nothing_else(tmp_path: Path) -> None:
    path = written(tmp_path)
    assert not runs.load(path, TYPES).is_torn
    path.write_text(path.read_text()[:-5])
    torn = runs.load(path, TYPES)
    assert (torn.records, torn.is_torn) == (RECORDS[:2], True)


# what is refused


def test_damage_in_the_middle_is_an_error_that_names_the_line(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="line 2: not JSON"):
        runs.load(edited(tmp_path, 2, "{"), TYPES)


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ('{"type": "sample", "index": "one"}', r"`int`, got `str` - at `\$\.index`"),
        ('{"type": "sample", "index": 1.5}', r"\$\.index"),
        ('{"type": "sample", "index": null}', r"\$\.index"),
        ('{"type": "sample", "seconds": 1.0}', "missing required field `index`"),
        ('{"type": "other", "index": 1}', "not a record"),
        ('{"index": 1}', "not a record"),
        ("[1, 2]", "not a record"),
    ],
)
def test_a_record_that_does_not_fit_its_type_is_refused_naming_the_line(
    tmp_path: Path, line: str, message: str
) -> None:
    with pytest.raises(InputError, match=f"line 3: .*{message}"):
        runs.load(edited(tmp_path, 3, line), TYPES)


def test_a_record_of_a_type_that_was_not_asked_for_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="line 3: not a record"):
        runs.load(written(tmp_path), {"sample": Sample})


def test_a_header_that_lacks_the_machine_is_refused(tmp_path: Path) -> None:
    header = {"type": "run", "schema": runs.SCHEMA, "command": "compare", "arguments": {}}
    with pytest.raises(InputError, match=r"line 1: .*machine"):
        runs.load(edited(tmp_path, 1, json.dumps(header)), TYPES)


@pytest.mark.parametrize("text", ["", "[]\n", '{"type": "other"}\n'])
def test_other_files_are_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "x.jsonl").write_text(text)
    with pytest.raises(InputError, match="not a run file"):
        runs.load(tmp_path / "x.jsonl", TYPES)


def test_a_later_format_is_refused_by_number(tmp_path: Path) -> None:
    (tmp_path / "x.jsonl").write_text('{"type": "run", "schema": 99}\n')
    with pytest.raises(InputError, match="99"):
        runs.load(tmp_path / "x.jsonl", TYPES)


def test_a_folder_that_cannot_be_created_is_reported_with_the_option_to_use(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(MachineError, match="--results"):
        run_writer.RunFile.create(tmp_path / "file", HEADER)


def test_a_run_without_a_record_is_the_latest_only_where_no_other_has_one(tmp_path: Path) -> None:
    older, newer = tmp_path / "a.jsonl", tmp_path / "b.jsonl"
    for number, file in enumerate((older, newer)):
        file.write_text('{"type": "run"}\n')
        os.utime(file, (number, number))
    assert runs.newest_first(tmp_path)[0] == newer
    older.write_text('{"type": "run"}\n{"type": "model"}\n')
    os.utime(older, (0, 0))
    assert runs.newest_first(tmp_path)[0] == older


def test_the_latest_is_the_newest(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no run file"):
        runs.newest_first(tmp_path)
    for age_s, name in ((10, "b"), (0, "a"), (20, "c")):
        (tmp_path / f"{name}.jsonl").write_text("{}")
        os.utime(tmp_path / f"{name}.jsonl", (1e9 - age_s, 1e9 - age_s))
    assert runs.newest_first(tmp_path)[0] == tmp_path / "a.jsonl"


def test_what_is_no_run_file_does_not_hide_an_older_one(tmp_path: Path) -> None:
    path = written(tmp_path)
    (tmp_path / "empty.jsonl").touch()
    (tmp_path / "dangling.jsonl").symlink_to("nowhere")
    (tmp_path / "folder.jsonl").mkdir()
    assert runs.newest_first(tmp_path)[0] == path


@pytest.mark.parametrize(
    "line",
    [
        '{"type": "sample", "index": NaN}',
        '{"type": "sample", "index": 1, "seconds": Infinity}',
        '{"type": "sample", "index": 1, "seconds": 1e999}',
        '{"type": "note", "text": "\\ud800"}',
        "[" * 100_000,
        '{"type": "note", "text": ' + "[" * 5_000 + "]" * 5_000 + "}",
        '{"type": "sample", "index": ' + "9" * 5_000 + "}",
        '{"type": ["sample"], "index": 1}',
        '{"type": "run"}',
    ],
)
def test_a_line_that_is_not_sound_json_of_its_type_is_refused(tmp_path: Path, line: str) -> None:
    with pytest.raises(InputError, match=r"x?.*line 3: ") as refusal:
        runs.load(edited(tmp_path, 3, line), TYPES)
    assert len(str(refusal.value)) < 600


def test_a_second_header_is_refused(tmp_path: Path) -> None:
    path = written(tmp_path)
    header = path.read_text().splitlines()[0]
    with pytest.raises(InputError, match="line 2: a second header"):
        runs.load(edited(tmp_path, 2, header), TYPES)


def test_texts_lose_their_control_characters_and_names_their_line_breaks(tmp_path: Path) -> None:
    line = json.dumps({"type": "note", "text": "a\x1b[1m\nb"})
    (note,) = runs.load(edited(tmp_path, 3, line), TYPES).of_type(Note)
    assert note.text == "a\\x1b[1m\\nb"


@pytest.mark.parametrize("name", ["\0", "x" * 5_000, "/dev/zero", ".", "missing.jsonl"])
def test_what_is_no_file_is_refused(name: str) -> None:
    with pytest.raises(InputError):
        runs.load(Path(name), TYPES)


def test_a_file_that_cannot_hold_its_header_is_not_left_behind(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*arguments: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(run_writer, "_write_line", fail)
    with pytest.raises(MachineError, match="No space left"):
        run_writer.RunFile.create(tmp_path, HEADER)
    assert list(tmp_path.iterdir()) == []
    path = tmp_path / "earlier.jsonl"
    path.write_text("earlier")
    with pytest.raises(MachineError, match="No space left"):
        run_writer.RunFile.rewrite(path, HEADER, RECORDS)
    assert [p.read_text() for p in tmp_path.iterdir()] == ["earlier"]


# continuing


def test_a_rewritten_file_holds_the_records_given_and_those_appended(tmp_path: Path) -> None:
    path = written(tmp_path)
    file = run_writer.RunFile.rewrite(path, HEADER, RECORDS[:1])
    file.append(Sample(9))
    file.close()
    assert runs.load(path, TYPES) == runs.Run(HEADER, (RECORDS[0], Sample(9)))


def test_a_number_that_is_not_finite_is_stored_as_nothing(tmp_path: Path) -> None:
    file = run_writer.RunFile.create(tmp_path, HEADER)
    file.append(Sample(1, float("nan")))
    file.append(Note("\udce9\n"))
    file.close()
    values = [json.loads(line) for line in file.path.read_text().splitlines()]
    assert values[1]["seconds"] is None
    assert values[2]["text"] == "\\udce9\\n"


def test_a_file_that_is_still_written_cannot_be_continued(tmp_path: Path) -> None:
    file = run_writer.RunFile.create(tmp_path, HEADER)
    with pytest.raises(MachineError, match="another mjbench is writing it"):
        run_writer.RunFile.rewrite(file.path, HEADER, ())
    file.append(Sample(1))
    file.close()
    again = run_writer.RunFile.rewrite(file.path, HEADER, (Sample(1),))
    with pytest.raises(MachineError, match="another mjbench is writing it"):
        run_writer.RunFile.rewrite(file.path, HEADER, ())
    again.close()
    assert runs.load(file.path, TYPES).records == (Sample(1),)
    assert list(tmp_path.iterdir()) == [file.path]


def test_records_that_are_dropped_stay_in_a_file_beside(tmp_path: Path) -> None:
    path = written(tmp_path)
    before = path.read_text()
    run_writer.RunFile.rewrite(path, HEADER, RECORDS).close()
    assert list(tmp_path.iterdir()) == [path]
    run_writer.RunFile.rewrite(path, HEADER, RECORDS[:1]).close()
    backup = path.with_name(f"{path.name}.bak")
    assert sorted(tmp_path.iterdir()) == [path, backup]
    assert backup.read_text() == before
    assert runs.newest_first(tmp_path)[0] == path
