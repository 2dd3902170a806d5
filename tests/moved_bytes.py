"""Moved libraries as bytes."""

import tempfile
from pathlib import Path

from mjbench.releases.moved_install import MovableImage


def moved(image: MovableImage, content: bytes, shift: int) -> bytes:
    """Return the content of a library's file, moved."""
    with tempfile.TemporaryDirectory() as name:
        source, target = Path(name) / "source", Path(name) / "target"
        source.write_bytes(content)
        size = image.write(source, target, shift)
        result = target.read_bytes()
    assert size == len(result)
    return result
