"""Files of arrays that expand to more than can be read."""

import zipfile
from pathlib import Path

import numpy as np
import pytest

from mjbench.errors import InputError
from mjbench.simulation import array_files, given_controls, models, state_file

CARTPOLE = models.load(models.resolve("cartpole"))


@pytest.fixture
def small_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(array_files, "MOST_BYTES", 10_000)


@pytest.mark.usefixtures("small_limit")
def test_states_and_controls_that_expand_too_far_are_not_read(tmp_path: Path) -> None:
    file = tmp_path / "bomb.npz"
    np.savez_compressed(file, qpos=np.zeros((1000, 2)), ctrl=np.zeros((2000, 1)))
    assert file.stat().st_size < array_files.MOST_BYTES
    with pytest.raises(InputError, match=r"bomb\.npz expands to 0\.0 GB; at most .* can be read"):
        state_file.read(file, CARTPOLE)
    with pytest.raises(InputError, match="save fewer rows"):
        given_controls.read(file, CARTPOLE)


@pytest.mark.usefixtures("small_limit")
def test_small_integers_that_are_too_large_as_numbers_are_not_read(tmp_path: Path) -> None:
    file = tmp_path / "bytes.npz"
    np.savez(file, qpos=np.zeros((2000, 2), np.int8))
    with pytest.raises(InputError, match="4,000 numbers, which is too many"):
        state_file.read(file, CARTPOLE)


def test_a_member_that_is_no_array_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "raw.npz"
    with zipfile.ZipFile(file, "w") as members:
        members.writestr("qpos", b"hello")
    with pytest.raises(InputError, match="qpos"):
        state_file.read(file, CARTPOLE)


@pytest.mark.usefixtures("small_limit")
def test_arrays_that_are_not_read_may_be_large(tmp_path: Path) -> None:
    file = tmp_path / "states.npz"
    np.savez_compressed(file, qpos=np.zeros((10, 2)), images=np.zeros(10_000))
    assert state_file.read(file, CARTPOLE).nrow == 10


@pytest.mark.usefixtures("small_limit")
def test_a_directory_that_understates_a_member_gives_no_more(tmp_path: Path) -> None:
    """zipfile reads as many bytes as the directory says, and NumPy misses the rest."""
    file, stated = tmp_path / "lie.npz", 1000
    np.savez_compressed(file, qpos=np.zeros((10_000, 2)))
    content = bytearray(file.read_bytes())
    place = content.rindex(b"PK\x01\x02") + 24
    content[place : place + 4] = stated.to_bytes(4, "little")
    file.write_bytes(content)
    with pytest.raises(InputError, match=r"cannot read states from lie\.npz"):
        state_file.read(file, CARTPOLE)
