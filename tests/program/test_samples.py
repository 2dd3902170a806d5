"""The profiler's file is read, or refused in one line."""

import json

import pytest

from mjbench.errors import InputError
from mjbench.program import samples
from mjbench.program.samples import Frame, Thread


def document(name='Process 7 Thread 8 "Main"'):
    return {
        "profiles": [{"name": name, "samples": [[0, 1, 2], [0, 1]], "weights": [0.02, 0.02]}],
        "shared": {
            "frames": [
                {"name": 'process 7:"python x.py"', "file": "", "line": 0},
                {"name": "main", "file": "/x.py", "line": 3},
                {"name": "mj_step", "file": "libmujoco.so", "line": 0},
            ]
        },
    }


def test_stacks_are_read_without_labels(tmp_path):
    file = tmp_path / "samples.json"
    file.write_text(json.dumps(document()))
    (thread,) = samples.read(file)
    assert thread.thread == Thread(7, 8, "Main")
    assert thread.interval_s == 0.02
    step = Frame("mj_step", "libmujoco.so", 0)
    assert thread.stacks == [[Frame("main", "/x.py", 3), step], [Frame("main", "/x.py", 3)]]


@pytest.mark.parametrize(
    "text", ["", "{}", "[]", '{"profiles": 3}', "\0", json.dumps(document("no thread"))]
)
def test_other_files_are_refused(tmp_path, text):
    file = tmp_path / "samples.json"
    file.write_text(text)
    with pytest.raises(InputError, match="profiler"):
        samples.read(file)


def test_samples_stand_for_the_time_in_which_they_were_taken():
    stack = [Frame("main", "/x.py", 3)]
    whole = samples.ThreadSamples(Thread(1, 1, "a"), [stack] * 4, 0.1)
    late = samples.ThreadSamples(Thread(1, 2, "b"), [stack], 0.1)
    spread = samples.spread_over([whole, late], 2.0)
    assert [each.interval_s for each in spread] == [0.5, 0.5]
    assert samples.spread_over([], 2.0) == []


def test_a_missing_file_is_refused(tmp_path):
    with pytest.raises(InputError, match="profiler's samples"):
        samples.read(tmp_path / "missing.json")
