import json
from pathlib import Path

import pytest

from mjbench.errors import InputError, MachineError
from mjbench.instrument import runs


def written(folder: Path) -> Path:
    file = runs.RunFile(folder, "compare", {"machine": {"cpu": "x"}})
    file.append({"type": "measurement", "n": 1})
    file.append({"type": "measurement", "n": 2})
    file.close()
    return file.path


def test_what_was_appended_comes_back_in_order(tmp_path: Path) -> None:
    header, *records = runs.load(written(tmp_path))
    assert header["schema"] == runs.SCHEMA
    assert [r["n"] for r in records] == [1, 2]


def test_every_record_is_on_disk_as_soon_as_it_is_appended(tmp_path: Path) -> None:
    file = runs.RunFile(tmp_path, "compare", {})
    file.append({"n": 1})
    assert json.loads(file.path.read_text().splitlines()[-1]) == {"n": 1}
    file.close()


def test_a_last_line_cut_short_loses_nothing_else(tmp_path: Path) -> None:
    path = written(tmp_path)
    path.write_text(path.read_text()[:-5])
    assert [r.get("n") for r in runs.load(path)] == [None, 1]


def test_damage_in_the_middle_is_an_error_that_names_the_line(tmp_path: Path) -> None:
    path = written(tmp_path)
    lines = path.read_text().splitlines()
    path.write_text("\n".join([lines[0], "{", lines[2]]))
    with pytest.raises(InputError, match="line 2"):
        runs.load(path)


@pytest.mark.parametrize("text", ["", "[]\n", '{"type": "other"}\n'])
def test_other_files_are_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "x.jsonl").write_text(text)
    with pytest.raises(InputError, match="not a run file"):
        runs.load(tmp_path / "x.jsonl")


def test_a_later_format_is_refused_by_number(tmp_path: Path) -> None:
    (tmp_path / "x.jsonl").write_text('{"type": "run", "schema": 99}\n')
    with pytest.raises(InputError, match="99"):
        runs.load(tmp_path / "x.jsonl")


def test_a_folder_that_cannot_be_made_is_told_with_the_way_out(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(MachineError, match="--results"):
        runs.RunFile(tmp_path / "file", "compare", {})


def test_the_latest_is_the_newest(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no run file"):
        runs.latest(tmp_path)
    assert runs.latest(written(tmp_path).parent).suffix == ".jsonl"
