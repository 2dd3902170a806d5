"""Run sets: what comes back, what is cut off, and what is refused."""

import errno
import hashlib
import json
import os
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import pytest
from set_files import section_of

from mjbench.errors import InputError, MachineError
from mjbench.host import machine
from mjbench.store import run_set, run_writer, runs
from mjbench.store.run_set import RunSection, RunSetFile


@dataclass(frozen=True)
class Note:
    """A record."""

    record_type: ClassVar[str] = "note"
    text: str
    index: int = 0


TYPES = {Note.record_type: Note}
HEADER = runs.RunHeader(runs.SCHEMA, "compare", machine.describe(), {})
RECORDS = (Note("first", 1), Note("second"), Note("third"))


def written(folder: Path) -> Path:
    """Return a run file with RECORDS."""
    file = run_writer.RunFile.create(folder, HEADER)
    for record in RECORDS:
        file.append(record)
    file.close()
    return file.path


def section(folder: Path, *notes: str, cell: str = "") -> RunSection:
    """Return a section with some notes."""
    file = run_writer.RunFile.create(folder / "runs", HEADER)
    for note in notes:
        file.append(Note(note))
    file.close()
    return section_of(file.path, TYPES, cell)


def set_of(path: Path, *sections: RunSection) -> Path:
    """Return a set of sections."""
    file = RunSetFile.create(path)
    for one in sections:
        file.append(one)
    file.close()
    return path


def two_sections(folder: Path) -> Path:
    """Return a set of two sections: lines 2 to 4, and lines 5 to 7."""
    return set_of(folder / "set.jsonl", section(folder, "a", cell="A"), section(folder, "b"))


# what comes back


def test_sections_come_back_in_order_with_their_cells(tmp_path: Path) -> None:
    read = run_set.read(two_sections(tmp_path), TYPES)
    assert [one.cell for one in read.sections] == ["A", ""]
    assert [one.run.records for one in read.sections] == [(Note("a"),), (Note("b"),)]
    assert all(one.run.header == HEADER for one in read.sections)
    assert not read.is_torn


def test_lines_are_kept_to_the_byte(tmp_path: Path) -> None:
    source = written(tmp_path)
    text = source.read_text().replace('"index": 1', '"index":   1,  "added": 1e0')
    source.write_text(text)
    path = set_of(tmp_path / "set.jsonl", section_of(source, TYPES))
    assert path.read_bytes().endswith(text.encode())
    assert b"".join(run_set.read(path, TYPES).sections[0].lines) == text.encode()


def test_the_file_is_what_the_documents_say(tmp_path: Path) -> None:
    path = set_of(tmp_path / "set.jsonl", section(tmp_path, "a", cell="A"))
    first, header, *lines = path.read_bytes().splitlines(keepends=True)
    assert json.loads(first) == {"type": "set", "schema": 1}
    assert json.loads(header) == {
        "type": "section",
        "lines": 2,
        "sha256": hashlib.sha256(b"".join(lines)).hexdigest(),
        "cell": "A",
    }


def test_a_set_is_no_program(tmp_path: Path) -> None:
    assert two_sections(tmp_path).stat().st_mode & 0o111 == 0


# a writer that was killed


def test_a_section_cut_short_anywhere_is_left_out_and_then_cut_off(tmp_path: Path) -> None:
    path, whole = two_sections(tmp_path), (tmp_path / "set.jsonl").read_bytes()
    start = len(b"".join(whole.splitlines(keepends=True)[:4]))
    for length in range(start + 1, len(whole)):
        path.write_bytes(whole[:length])
        if length % 37 == 0 or length > len(whole) - 3:
            read = run_set.read(path, TYPES)
            assert read.is_torn
            assert len(read.sections) == 1
        RunSetFile.open(path).close()
        assert path.read_bytes() == whole[:start]


def test_what_is_appended_stands_behind_the_last_whole_section(tmp_path: Path) -> None:
    path = two_sections(tmp_path)
    path.write_bytes(path.read_bytes()[:-1])
    file = RunSetFile.open(path)
    file.append(section(tmp_path, "c"))
    file.close()
    read = run_set.read(path, TYPES)
    assert not read.is_torn
    assert [one.run.records for one in read.sections] == [(Note("a"),), (Note("c"),)]


@pytest.mark.parametrize("length", [0, 1, 20, len('{"type": "set", "schema": 1}')])
def test_a_first_line_cut_short_is_written_again(tmp_path: Path, length: int) -> None:
    path = set_of(tmp_path / "set.jsonl")
    whole = path.read_bytes()
    path.write_bytes(whole[:length])
    RunSetFile.open(path).close()
    assert path.read_bytes() == whole


def test_a_disk_that_is_full_leaves_earlier_sections(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = two_sections(tmp_path)
    before = path.read_bytes()
    file = RunSetFile.open(path)
    opened = file._file

    class Full:
        """A file that takes ten bytes."""

        fileno, truncate, close = opened.fileno, opened.truncate, opened.close
        taken = 0

        def write(self, content: bytes) -> int:
            if self.taken:
                raise OSError(errno.ENOSPC, "No space left on device")
            self.taken = opened.write(content[:10])
            return self.taken

    monkeypatch.setattr(file, "_file", Full())
    with pytest.raises(MachineError, match="No space left"):
        file.append(section(tmp_path, "c"))
    assert path.read_bytes() == before
    file.close()


# what is refused


def test_one_process_writes_at_a_time(tmp_path: Path) -> None:
    file = RunSetFile.create(tmp_path / "set.jsonl")
    with pytest.raises(MachineError, match="another mjbench is writing it"):
        RunSetFile.open(file.path)
    file.close()
    RunSetFile.open(file.path).close()


def test_a_file_that_exists_is_not_created(tmp_path: Path) -> None:
    path = two_sections(tmp_path)
    before = path.read_bytes()
    with pytest.raises(MachineError, match="File exists"):
        RunSetFile.create(path)
    assert path.read_bytes() == before


def test_a_file_that_is_missing_is_not_opened(tmp_path: Path) -> None:
    with pytest.raises(MachineError, match="No such file"):
        RunSetFile.open(tmp_path / "set.jsonl")
    assert list(tmp_path.iterdir()) == []


def test_what_is_no_file_is_not_opened(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(InputError, match="not a file"):
        RunSetFile.open(tmp_path / "pipe")
    with pytest.raises(MachineError, match="Is a directory"):
        RunSetFile.open(tmp_path)


def test_a_run_file_is_not_continued_as_a_set(tmp_path: Path) -> None:
    path = written(tmp_path)
    before = path.read_bytes()
    with pytest.raises(InputError, match="not a run set"):
        RunSetFile.open(path)
    assert path.read_bytes() == before


def edited(folder: Path, number: int, line: str) -> Path:
    """Return `two_sections` whose line `number`, counted from 1, is another."""
    path = two_sections(folder)
    lines = path.read_text().splitlines()
    lines[number - 1] = line
    path.write_text("".join(f"{text}\n" for text in lines))
    return path


SECTION = '{"type": "section", "lines": %d, "sha256": "%s"}'


@pytest.mark.parametrize(
    ("number", "line", "message"),
    [
        (4, '{"type": "note", "text": "x"}', "line 2: the section is not as it was written"),
        (7, '{"type": "note", "text": "x"}', "line 5: the section is not as it was written"),
        (3, '{"type": "set", "schema": 1}', "line 3: a section begins within the one of line 2"),
        (2, SECTION % (99, "0"), "line 5: a section begins within the one of line 2"),
        (2, SECTION % (1, "0"), "line 2: the section is not as it was written"),
        (5, SECTION % (0, "0"), "line 5: a section of 0 lines"),
        (5, SECTION % (-1, "0"), "line 5: a section of -1 lines"),
        (5, '{"type": "section", "lines": "2"}', r"line 5: .*\$\.lines"),
        (5, '{"type": "note", "text": "x"}', "line 5: not the first line of a section"),
        (5, "x", "line 5: JSON is malformed"),
        (5, "[1]", "line 5: not the first line of a section"),
        (1, '{"type": "set", "schema": 99}', "format 99"),
        (1, '{"type": "section", "lines": 2, "sha256": ""}', "line 1: not the first line of a set"),
    ],
)
def test_a_set_that_was_edited_is_refused_and_left_alone(
    tmp_path: Path, number: int, line: str, message: str
) -> None:
    path = edited(tmp_path, number, line)
    before = path.read_bytes()
    with pytest.raises(InputError, match=message):
        run_set.read(path, TYPES)
    with pytest.raises(InputError, match=message):
        RunSetFile.open(path)
    assert path.read_bytes() == before


def test_a_count_too_large_for_lines_that_are_all_there_is_refused(tmp_path: Path) -> None:
    path = two_sections(tmp_path)
    header = json.loads(path.read_text().splitlines()[4])
    path = edited(tmp_path / "again", 5, SECTION % (3, header["sha256"]))
    with pytest.raises(InputError, match="line 5: the section is not as it was written"):
        run_set.read(path, TYPES)


def with_lines(folder: Path, *lines: bytes) -> Path:
    """Return a set of one section with these lines, whatever they are."""
    return set_of(folder / "set.jsonl", RunSection("", runs.Run(HEADER, ()), lines))


def test_a_set_within_a_set_is_refused(tmp_path: Path) -> None:
    inner = two_sections(tmp_path).read_bytes().splitlines(keepends=True)
    (tmp_path / "outer").mkdir()
    with pytest.raises(InputError, match="line 3: a section begins within"):
        run_set.read(with_lines(tmp_path / "outer", *inner), TYPES)


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        ([b'{"type": "note", "text": "x"}\n'], "line 3: not a run file"),
        ([b"{\n"], "line 3: not JSON"),
        ([b"HEADER", b"{\n"], "line 4: not JSON"),
        ([b"HEADER", b'{"type": "other"}\n'], "line 4: not a record"),
        ([b"HEADER", b"HEADER"], "line 4: a second header"),
    ],
)
def test_a_section_that_is_no_run_is_refused(
    tmp_path: Path, lines: list[bytes], message: str
) -> None:
    header = section(tmp_path).lines[0]
    path = with_lines(tmp_path, *(header if line == b"HEADER" else line for line in lines))
    with pytest.raises(InputError, match=message):
        run_set.read(path, TYPES)


@pytest.mark.parametrize("text", ["", "\n", "x", "[]\n", '{"type": "other"}\n', "\0" * 9])
def test_other_files_are_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "x.jsonl").write_text(text)
    with pytest.raises(InputError, match=r"not a run set|not JSON"):
        run_set.read(tmp_path / "x.jsonl", TYPES)


def test_control_characters_in_the_name_of_a_cell_are_escaped(tmp_path: Path) -> None:
    path = set_of(tmp_path / "set.jsonl", section(tmp_path, "a", cell="\x1b[1m\nb"))
    assert len(path.read_text().splitlines()) == 4
    assert run_set.read(path, TYPES).sections[0].cell == "\\x1b[1m\\nb"
