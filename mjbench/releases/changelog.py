"""MuJoCo's changelog, which its wheels carry from 4.0.0 on: items, and which fit some functions."""

import math
import re
from collections import Counter
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path

from mjbench.errors import InputError

# Where the changelog is in an installed package.
FILE = Path("mujoco") / "doc" / "changelog.rst"
_VERSION = re.compile(r"Version (\d+(?:\.\d+)+)\b")
_ITEM = re.compile(r"(\s*)(?:\d+|#)\. +(\S.*)")
_UNDERLINE = re.compile(r"([-^=~])\1{3,}\s*$")
# A directive, such as an image, or one of its options.
_DIRECTIVE = re.compile(r"\s*(\.\. |:[\w-]+:(\s|$))")
_COMMIT = re.compile(r":commit:`([0-9a-f]+)`,?\s*")
# `:role:`text<target>``, `text <url>`__ and ``literal``, of which the text stays.
_ROLE = re.compile(r":[a-z:]+:`([^`<]*?)\s*(?:<[^`>]*>)?`")
_LINK = re.compile(r"`([^`<]*?)\s*<[^`>]*>`__?")
_LITERAL = re.compile(r"``([^`]*)``")
# Parts of the names of MuJoCo's functions that say nothing of what they do.
_AFFIXES = frozenset({"mj", "mju", "mjc", "mjd", "mjraw", "mjp", "impl"})
# So many characters of an item say what it is about.
_SUBJECT = 300
# Shorter words are in every item.
_MIN_LETTERS = 4
# An item fits where its words are so rare in the whole changelog, together, in natural logarithms.
_MIN_SCORE = 4.0


@dataclass(frozen=True)
class ChangelogItem:
    """One item of the changelog.

    Attributes:
      release: in which it came.
      commits: by which the changelog names it.
      text: without markup, in one line.
    """

    release: str
    commits: tuple[str, ...]
    text: str

    @property
    def words(self) -> frozenset[str]:
        """The words that say what it is about; long items list details at their end."""
        return frozenset(words_of(self.text[:_SUBJECT]))


class Changelog:
    """Items that can be searched."""

    def __init__(self, items: Sequence[ChangelogItem]):
        """Count how many items have each word."""
        self.items = items
        self._frequency = Counter(word for item in items for word in item.words)

    def fitting(
        self, release: str, functions: Collection[str], features: Collection[str] = ()
    ) -> ChangelogItem | None:
        """Return the item of a release that fits best; None where none fits.

        Args:
          release: of MuJoCo.
          functions: names of functions whose cost changed.
          features: further words, such as `contact`, for where functions alone fit nothing.
        """
        for names in (functions, [*functions, *features]):
            wanted = {word for name in names for word in words_of(name)}
            scores = [(self._score(i, wanted), i) for i in self.items if i.release == release]
            score, item = max(scores, key=lambda pair: pair[0], default=(0.0, None))
            if score >= _MIN_SCORE:
                return item
        return None

    def naming(self, release: str, names: Collection[str]) -> ChangelogItem | None:
        """Return the item of a release that has most of these names; None where none has one.

        Of several items that have as many, the one whose names are rarer is returned.
        """
        items = [i for i in self.items if i.release == release and not i.words.isdisjoint(names)]
        return max(items, key=lambda item: self._score(item, names), default=None)

    def _score(self, item: ChangelogItem, wanted: Collection[str]) -> float:
        common = item.words & set(wanted)
        return sum(math.log(len(self.items) / self._frequency[word]) for word in common)


def installed() -> Changelog | None:
    """Return the changelog of the installed MuJoCo; None where its package carries none.

    Raises:
      InputError: it cannot be read.
    """
    try:
        file = Path(str(metadata.distribution("mujoco").locate_file(str(FILE))))
    except metadata.PackageNotFoundError:
        return None
    return read(file) if file.exists() else None


def read(file: Path) -> Changelog:
    """Read the changelog of an installed package.

    Raises:
      InputError: it cannot be read.
    """
    try:
        return Changelog([*parse(file.read_text(encoding="utf-8"))])
    except (OSError, ValueError) as error:
        raise InputError(f"cannot read {file}: {error}") from error


def parse(text: str) -> Iterator[ChangelogItem]:
    """Yield the items of a changelog, in reStructuredText."""
    release, item, depth = "", [""], 0
    for line in (*text.splitlines(), "Version 0.0"):
        version, begin = _VERSION.match(line), _ITEM.match(line)
        if version or begin or _UNDERLINE.match(line) or _dedents(line, depth):
            if any(item):
                yield _item(release, " ".join(item))
            item = []
        if version:
            release = version[1]
        elif begin:
            depth, item = len(begin[1]), [begin[2]]
        elif item and not _DIRECTIVE.match(line):
            item.append(line.strip())


def _dedents(line: str, depth: int) -> bool:
    """Return whether a line is not of the item that began with so many spaces."""
    return bool(line.strip()) and len(line) - len(line.lstrip()) <= depth


def _item(release: str, text: str) -> ChangelogItem:
    commits = tuple(_COMMIT.findall(text))
    for markup, replacement in ((_COMMIT, ""), (_ROLE, r"\1"), (_LITERAL, r"\1"), (_LINK, r"\1")):
        text = markup.sub(replacement, text)
    return ChangelogItem(release, commits, " ".join(text.split()))


def words_of(text: str) -> Iterator[str]:
    """Yield the words of a text or of a function's name, in lower case and in the singular."""
    for name in re.findall(r"[A-Za-z_]\w*", text):
        yield name
        parts = re.findall(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])|\d+", name)
        for part in parts:
            word = part.lower()
            if len(word) >= _MIN_LETTERS and word not in _AFFIXES:
                yield word.removesuffix("s")
