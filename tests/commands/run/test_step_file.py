"""A file is mapped into memory once it has all its space; without that, to write ends a process."""

import errno
import os

import pytest

from mjbench.commands.run import step_times
from mjbench.commands.run.hook import step_file

SIZE = 3 << 12


def test_a_file_has_its_space_before_it_is_mapped(tmp_path):
    memory = step_file.map_file(str(tmp_path / "1.steps"), SIZE)
    assert bytes(memory) == bytes(SIZE)
    assert 512 * (tmp_path / "1.steps").stat().st_blocks >= SIZE


def test_so_it_has_where_the_system_has_no_function_for_that(tmp_path, monkeypatch):
    monkeypatch.delattr(os, "posix_fallocate", raising=False)
    test_a_file_has_its_space_before_it_is_mapped(tmp_path)


def test_a_file_without_space_is_empty(tmp_path, monkeypatch):
    def refuse(*arguments):
        os.ftruncate(arguments[0], SIZE)  # as a C library may that has no such function
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "posix_fallocate", refuse, raising=False)
    with pytest.raises(OSError, match="No space left"):
        step_file.StepFile(str(tmp_path))
    (file,) = tmp_path.iterdir()
    assert file.stat().st_size == 0
    assert step_times.untimed_pids(tmp_path) == {os.getpid()}
    assert step_times.read_all(tmp_path) == []
    assert step_times.read_headers(tmp_path) == {}


def test_memory_alone_leaves_no_file(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    file = step_file.StepFile(os.devnull)
    assert file.write(step_file.STEP, 1, 2, 1, 0) == 1
    assert list(tmp_path.iterdir()) == []
