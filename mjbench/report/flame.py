"""The samples of a program as a flame graph: SVG, or a profile that speedscope opens.

speedscope's format is https://www.speedscope.app/file-format-schema.json.
"""

import json
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, field
from html import escape
from pathlib import Path

from mjbench.errors import InputError, printable, shown, writing
from mjbench.program import activities
from mjbench.program.hook import file_owners
from mjbench.program.py_spy import Frame, ThreadSamples

# Of the picture, in pixels; frames narrower than the last are left out.
_WIDTH, _ROW, _LEAST_WIDTH = 1200, 18, 0.5
# Pixels of a letter, and colours: of the user's own code, of packages, and of all else.
_LETTER = 7
_OWN, _PACKAGE, _OTHER = "#8ab6e8", "#b9d8a8", "#d9d9d9"


@dataclass
class _Node:
    """A frame with what it calls; all threads together without a frame."""

    frame: Frame | None
    seconds: float = 0.0
    callees: "dict[Frame, _Node]" = field(default_factory=dict)

    @property
    def depth(self) -> int:
        """How many frames stand on it, itself included."""
        return 1 + max((node.depth for node in self.callees.values()), default=0)


def check(file: Path) -> None:
    """Refuse a file of another kind before the program runs.

    Raises:
      InputError: its name ends with neither `.svg` nor `.json`.
    """
    if file.suffix not in (".svg", ".json"):
        raise InputError(f"--output {shown(str(file))}: name a file that ends with .svg or .json")


def write(file: Path, threads: Sequence[ThreadSamples]) -> None:
    """Write the samples of all threads, as the file's name asks for.

    Raises:
      InputError: it cannot be written.
    """
    text = _picture(threads) if file.suffix == ".svg" else json.dumps(_speedscope(threads))
    with writing(file):
        file.write_text(text, encoding="utf-8")


def _speedscope(threads: Sequence[ThreadSamples]) -> dict[str, object]:
    numbers: dict[Frame, int] = {}
    profiles = [
        {
            "type": "sampled",
            "name": f"process {thread.thread.pid}, {thread.thread.name or thread.thread.tid}",
            "unit": "seconds",
            "startValue": 0,
            "endValue": len(thread.stacks) * thread.interval_s,
            "samples": [
                [numbers.setdefault(frame, len(numbers)) for frame in stack]
                for stack in thread.stacks
            ],
            "weights": [thread.interval_s] * len(thread.stacks),
        }
        for thread in threads
    ]
    frames = [{"name": each.function, "file": each.file, "line": each.line} for each in numbers]
    return {
        "$schema": "https://www.speedscope.app/file-format-schema.json",
        "shared": {"frames": frames},
        "profiles": profiles,
        "exporter": "mjbench",
    }


def _picture(threads: Sequence[ThreadSamples]) -> str:
    """Return the flame graph of all threads: what a frame calls stands on it."""
    root = _Node(None)
    for thread in threads:
        for stack in thread.stacks:
            node = root
            node.seconds += thread.interval_s
            for frame in stack:
                node = node.callees.setdefault(frame, _Node(frame))
                node.seconds += thread.interval_s
    height = root.depth * _ROW
    scale = _WIDTH / root.seconds if root.seconds else 0.0
    boxes: dict[int, list[str]] = defaultdict(list)
    waiting = [(root, 0.0, 0)]
    while waiting:
        node, left, level = waiting.pop()
        if node.seconds * scale < _LEAST_WIDTH:
            continue
        boxes[level].append(_box(node, left, height - (level + 1) * _ROW, scale, root.seconds))
        for callee in sorted(node.callees.values(), key=lambda each: -each.seconds):
            waiting.append((callee, left, level + 1))
            left += callee.seconds * scale
    svg = f'svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {_WIDTH} {height}"'
    lines = [box for level in sorted(boxes) for box in boxes[level]]
    return "\n".join([f'<{svg} font-family="monospace" font-size="11">', *lines, "</svg>\n"])


def _box(node: _Node, left: float, top: float, scale: float, total_s: float) -> str:
    """Return the rectangle of a frame, with its name if that fits, and all of it on hovering."""
    frame, width = node.frame, node.seconds * scale
    name, colour = "all threads", _OTHER
    if frame is not None:
        place = f"{activities.shown_path(frame.file)}:{frame.line}" if frame.line else frame.file
        name = f"{frame.function} ({place})"
        package = file_owners.package_of(frame.file)
        colour = _OWN if activities.is_own(frame) else _OTHER
        if package and package != file_owners.STANDARD_LIBRARY:
            colour = _PACKAGE
    title = f"{name}: {node.seconds:.3g} s, {100 * node.seconds / total_s:.1f} %"
    text = printable(name)[: int(width / _LETTER)]
    label = f'<text x="{left + 3:.1f}" y="{top + 13:.1f}">{escape(text)}</text>'
    return (
        f"<g><title>{escape(printable(title))}</title>"
        f'<rect x="{left:.1f}" y="{top:.1f}" width="{width:.1f}" height="{_ROW - 1}"'
        f' fill="{colour}"/>{label if len(text) > 2 else ""}</g>'
    )
