"""Start states and controls from a program: a file, or arrays."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mjbench.api import start_states
from mjbench.errors import InputError


@pytest.mark.parametrize(
    ("name", "given", "stored"),
    [
        ("states", {"qpos": np.arange(6.0).reshape(3, 2)}, lambda file: file["qpos"].tolist()),
        ("actions", [[0.5], [1.0]], lambda array: array.tolist()),
    ],
)
def test_arrays_lie_in_a_file_as_long_as_they_are_needed(
    name: str, given: Any, stored: Any
) -> None:
    with start_states.in_files({name: given, "hold": 2}) as files:
        assert list(files) == [name]
        expected = given["qpos"].tolist() if name == "states" else given
        assert stored(np.load(files[name])) == expected
    assert not files[name].exists()


def test_a_file_stays(tmp_path: Path) -> None:
    file = tmp_path / "states.npz"
    np.savez(file, qpos=np.zeros((2, 2)))
    with start_states.in_files({"states": str(file), "actions": None}) as files:
        assert files == {"states": file}
    assert file.exists()


@pytest.mark.parametrize(
    ("name", "given", "message"),
    [
        ("states", [1, 2], "states are a path, or arrays"),
        ("states", {"file": [[0.0]]}, "cannot be stored as arrays"),
        ("actions", [["a"]], "actions cannot be stored"),
        ("actions", {"ctrl": 1}, "actions cannot be stored"),
        ("actions", [[1.0], [1.0, 2.0]], "actions cannot be stored"),
    ],
)
def test_what_is_no_array_is_refused(name: str, given: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        start_states.in_files({name: given}).__enter__()
