"""Temporary folders, and those of processes that were killed."""

import os
import re
import tempfile
from pathlib import Path

import pytest

from mjbench.host import files


def test_the_folder_of_a_killed_parent_is_removed_by_the_next_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    with files.temporary_folder() as folder:
        prefix, own_pid, _ = folder.name.rpartition(f"{os.getpid()}-")
    assert own_pid
    dead, alive = (tmp_path / f"{prefix}{pid}-x" for pid in (2**22 + 1, os.getpid()))
    dead.mkdir()
    alive.mkdir()
    with files.temporary_folder():
        pass
    assert not dead.exists()
    assert alive.exists()


def test_only_this_module_creates_temporary_folders() -> None:
    """What others create would stay after kill -9; a folder below the current one is below this."""
    package = Path(files.__file__).parent.parent
    call = re.compile(r"(TemporaryDirectory|mkdtemp)\((?!.*dir=Path\.cwd\(\))")
    files_of = {file.relative_to(package).as_posix(): file for file in package.rglob("*.py")}
    creating = {name for name, file in files_of.items() if call.search(file.read_text())}
    assert creating == {"host/files.py"}
