"""The bytes of a moved library."""

from pathlib import Path

import numpy as np
import pytest
from moved_bytes import moved

from mjbench.releases.moved_image import MovableImage

# Of 64 bytes 16 stay. Numbers are at 8 and 24, permissions at 1, an instruction at 40.
CONTENT = bytes(range(64))
IMAGE = MovableImage(
    insert_at=16,
    addresses=np.array([8, 24]),
    permissions=np.array([[1, 5]]),
    unaligned=np.array([[40, 0x10], [41, 0x11]]),
)


def number(content: bytes, place: int) -> int:
    return int.from_bytes(content[place : place + 8], "little")


@pytest.mark.parametrize("shift", [16, 32, 48, 4080])
def test_bytes_are_inserted_and_numbers_grow_by_as_many(shift: int) -> None:
    result = moved(IMAGE, CONTENT, shift)
    assert len(result) == len(CONTENT) + shift
    assert result[16 : 16 + shift] == bytes(shift)
    assert number(result, 8) == number(CONTENT, 8) + shift
    assert number(result, 24 + shift) == number(CONTENT, 24) + shift
    assert result[1] == 5


@pytest.mark.parametrize("shift", [16, 32])
def test_nothing_else_changes(shift: int) -> None:
    result = moved(IMAGE, CONTENT, shift)
    back = bytearray(result[:16] + result[16 + shift :])
    named = {*range(8, 16), *range(24, 32), 1, 40, 41}
    assert all(back[i] == CONTENT[i] for i in set(range(64)) - named)


@pytest.mark.parametrize(("shift", "expected"), [(16, b"\x10\x11"), (32, CONTENT[40:42])])
def test_instructions_change_only_where_vectors_lose_their_alignment(
    shift: int, expected: bytes
) -> None:
    assert moved(IMAGE, CONTENT, shift)[40 + shift : 42 + shift] == expected


def test_a_library_that_is_moved_by_nothing_is_the_same() -> None:
    assert moved(IMAGE, CONTENT, 0) == CONTENT


def test_an_address_may_carry_into_its_last_byte() -> None:
    content = bytes(8) + b"\xf8" + 7 * b"\xff" + bytes(16)
    image = MovableImage(0, np.array([8]), *2 * [np.empty((0, 2), np.int64)])
    assert number(moved(image, content, 16), 8 + 16) == 8


def test_a_file_that_exists_is_not_written_over(tmp_path: Path) -> None:
    source, target = tmp_path / "source", tmp_path / "target"
    source.write_bytes(CONTENT)
    target.write_bytes(b"mine")
    with pytest.raises(FileExistsError):
        IMAGE.write(source, target, 16)
    assert target.read_bytes() == b"mine"
