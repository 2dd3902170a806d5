"""MuJoCo's changelog, which its wheels carry from 4.0.0 on: items, and which fit some functions."""

import functools
import math
import re
from collections.abc import Collection, Iterator, Mapping, Sequence
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
# `:role:`text<target>``, `text <url>`__, ``literal`` and **bold**, of which the text stays.
_ROLE = re.compile(r":[a-z:]+:`([^`<]*?)\s*(?:<[^`>]*>)?`")
_LINK = re.compile(r"`([^`<]*?)\s*<[^`>]*>`__?")
_LITERAL = re.compile(r"``([^`]*)``")
_BOLD = re.compile(r"\*\*([^*]+)\*\*")
# Where the first clause of an item ends.
_CLAUSE_END = re.compile(r"[.,:;](?=\s|$)|\s\(")
# What an item begins with, which says nothing of what it is about.
_VERB = re.compile(r"(?:[A-Z][a-z]+ed|Add|Fix|Remove)\b(?: a bug in| a bug where)?")
_WORD = re.compile(r"[A-Za-z_]\w*")
_PART = re.compile(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])")
# Begins the name of a function, a macro or a type of MuJoCo.
_PREFIX = re.compile(r"(?:mj[a-z]{0,3}_|[mM]j(?=[A-Z]))")
# Parts of the names of functions that say nothing of what they do.
_SUFFIXES = frozenset({"impl"})
# A word of an item stands for a part of a name that it begins with, from so many letters on.
_MIN_LETTERS = 3
# An item is about a name where what they share is so rare in the whole changelog, in natural
# logarithms: one item in forty has it.
_MIN_SCORE = 3.7
# A function counts whose cost changed by this share of the largest change.
_MIN_SHARE = 0.25
# An item that has a counter of work among so many first words is about it.
_FIRST_WORDS = 3
# So many characters are the first sentences of an item; lists of details follow.
_FIRST_LETTERS = 300


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

    @functools.cached_property
    def subject(self) -> str:
        """What it is about: its first clause, without the verb. Details follow later."""
        clause = _CLAUSE_END.split(self.text, maxsplit=1)[0]
        return _VERB.sub("", clause, count=1) if _VERB.match(clause) else clause

    @functools.cached_property
    def names(self) -> frozenset[str]:
        """The names of MuJoCo's functions, macros and types in its subject, as `_bare` has them."""
        words = _WORD.findall(self.subject)
        return frozenset(_bare(word) for word in words if _PREFIX.match(word))

    @functools.cached_property
    def words(self) -> frozenset[str]:
        """The words of its subject and the parts of its names, in lower case."""
        return frozenset(part for word in _WORD.findall(self.subject) for part in _parts(word))

    @functools.cached_property
    def mentions(self) -> frozenset[str]:
        """The words of its subject, and MuJoCo's names in its first sentences, as written."""
        names = (w for w in _WORD.findall(self.text[:_FIRST_LETTERS]) if _PREFIX.match(w))
        return frozenset([*names, *_WORD.findall(self.subject)])

    def has(self, part: str) -> bool:
        """Return whether a word of its subject is a part of a name, or begins with it."""
        if len(part) < _MIN_LETTERS:
            return part in self.words
        return any(word.startswith(part) for word in self.words)


class Changelog:
    """Items that can be searched."""

    def __init__(self, items: Sequence[ChangelogItem]):
        """Take items of all releases: how rare a word is among them says how much it means."""
        self.items = items
        self._rarities: dict[str, float] = {}

    def fitting(
        self, release: str, differences: Mapping[str, float], counters: Collection[str] = ()
    ) -> ChangelogItem | None:
        """Return the item of a release that fits what changed best; None where none fits.

        An item fits a function that its first clause names, or where it has every part of the
        function's name. A common word does not suffice: most changes have another cause.

        Args:
          release: of MuJoCo.
          differences: by how much the cost of functions changed, by their names.
          counters: of work that changed, such as `contacts`, for where no function fits.
        """
        items = [item for item in self.items if item.release == release]
        largest = max(map(abs, differences.values()), default=0.0)
        main = {n: abs(d) for n, d in differences.items() if abs(d) >= _MIN_SHARE * largest}
        bare = {_bare(name) for name in differences}
        fits = []
        for item in items:
            if not _is_of_another_function(item, bare):
                scores = {name: self._score(item, name) for name in main}
                about = [name for name, score in scores.items() if score >= _MIN_SCORE]
                if about:
                    cost = sum(main[name] for name in about)
                    fits.append((cost, max(scores.values()), item))
        if fits:
            return max(fits, key=lambda fit: fit[:2])[2]
        return next((item for item in items if _begins_with(item, counters)), None)

    def naming(self, release: str, names: Collection[str]) -> ChangelogItem | None:
        """Return the item of a release that has most of these names; None where none has one.

        An item has a name such as `mj_ray` in its first sentences, and one that is a word, such as
        `rollout`, in its first clause. Of several that have as many, the one whose names are rarer
        is returned. Names that many items have say nothing.
        """
        rare = {name for name in names if self._rarity(name) >= _MIN_SCORE}
        items = [i for i in self.items if i.release == release and not rare.isdisjoint(i.mentions)]
        return max(items, key=lambda i: sum(map(self._rarity, rare & i.mentions)), default=None)

    def _score(self, item: ChangelogItem, name: str) -> float:
        """Return how rare it is for an item to be about a name; 0 where this one is not."""
        parts = list(_parts(name))
        is_named = _bare(name) in item.names
        if not is_named and not all(map(item.has, parts)):
            return 0.0
        return self._rarity(name) if is_named else sum(map(self._rarity, parts))

    def _rarity(self, word: str) -> float:
        """Return how rare it is for items to name something, or to have a word."""
        if word not in self._rarities:
            count = sum(word in item.mentions or item.has(word) for item in self.items)
            self._rarities[word] = math.log(len(self.items) / count) if count else math.inf
        return self._rarities[word]


def _is_of_another_function(item: ChangelogItem, bare_names: Collection[str]) -> bool:
    """Return whether an item begins with the name of a function that is not one of these."""
    first = _WORD.match(item.subject)
    return first is not None and "_" in first[0] and _bare(first[0]) not in bare_names


def _begins_with(item: ChangelogItem, counters: Collection[str]) -> bool:
    """Return whether the first words of an item name a counter of work."""
    first = [word.lower() for word in _WORD.findall(item.subject)[:_FIRST_WORDS]]
    return not set(counters).isdisjoint(first)


def _bare(name: str) -> str:
    """Return `stackalloc` for `mj_stackAlloc`, `mjSTACKALLOC` and `stackalloc`."""
    return _PREFIX.sub("", name, count=1).replace("_", "").lower()


def _parts(name: str) -> Iterator[str]:
    """Yield the parts of a name, or of a word, in lower case and in the singular."""
    for part in _PART.findall(_PREFIX.sub("", name, count=1)):
        word = part.lower()
        if word not in _SUFFIXES:
            yield word.removesuffix("s") if len(word) > _MIN_LETTERS else word


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
    text = _COMMIT.sub("", text)
    for markup in (_ROLE, _LITERAL, _LINK, _BOLD):
        text = markup.sub(r"\1", text)
    return ChangelogItem(release, commits, " ".join(text.split()))
