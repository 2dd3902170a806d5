"""Compare the machine code of the functions that a step executes in two releases.

Functions are matched by their names, and by their code where they were renamed. Callgrind gives
the addresses of what was executed, and the library's symbol table the functions that they belong
to; so mangled names, clones made by the compiler and static functions of one name need no guessing.

Needs capstone and pyelftools.
"""

import difflib
import functools
import itertools
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from mjbench.counts import machine_code, shared_library
from mjbench.counts.callgrind import CodePlace, source_name
from mjbench.counts.function_differences import CodeChanges
from mjbench.counts.machine_code import Instruction
from mjbench.counts.records import CodeChange
from mjbench.counts.shared_library import SharedLibrary, Symbol
from mjbench.counts.stages import ENGINE
from mjbench.errors import MachineError

# How much can have changed in a function of both releases, from least to most.
_SEVERITY = (CodeChange.IDENTICAL, CodeChange.OFFSETS, CodeChange.CHANGED)

# A function is the same under another name where this share of the code is, or a smaller share and
# most of the name. Among the functions that only one of two releases executes on a humanoid (MuJoCo
# 2.3.7 and 3.2.1, 2.3.7 and 3.4.0, 3.3.1 and 3.4.0) or a pile of boxes (3.17.0 and 4.0.0), renamed
# ones share 0.42 to 0.97 of the code and 0.71 to 0.96 of the name, others up to 0.57 and 0.55.
MIN_SIMILARITY = 0.75
MIN_SIMILARITY_OF_LIKE_NAMES = 0.4
MIN_SIMILARITY_OF_NAMES = 0.7
# Shorter functions are similar by chance.
MIN_INSTRUCTIONS = 10

# How the name of the engine's library begins.
_PREFIX = "libmujoco."

# Where each executed function lies, by Callgrind's name.
Places = Mapping[str, Sequence[CodePlace]]
# The code of functions, by name.
Codes = Mapping[str, Sequence[Instruction]]


def _read(file: Path) -> SharedLibrary:
    """Return a library; one that was read before, and has not changed since, is not read again."""
    try:
        status = file.stat()
    except OSError:  # `read` says why
        return _read_version(file, None)
    return _read_version(file, (status.st_ino, status.st_mtime_ns))


@functools.lru_cache(maxsize=3)  # with the functions that were decoded, each takes 60 MB or more
def _read_version(file: Path, version: tuple[int, int] | None) -> SharedLibrary:
    return shared_library.read(file)


def compare(
    baseline: Places, candidate: Places, read: Callable[[Path], SharedLibrary] = _read
) -> CodeChanges:
    """Return how the code of the executed functions changed.

    Functions of other libraries than the engine's, such as memcpy of the C library, are identical
    where both releases execute the same file, and otherwise unknown.
    """
    functions = _engine_changes(_executed(baseline, read), _executed(candidate, read))
    of_engine = {*functions.changes, *functions.old_names.values()}
    elsewhere = [name for name in {**baseline, **candidate} if name not in of_engine]
    return CodeChanges(
        {**_file_changes(elsewhere, baseline, candidate), **functions.changes}, functions.old_names
    )


def _executed(places: Places, read: Callable[[Path], SharedLibrary]) -> "_Executed":
    file = _engine_file(places)
    library = read(Path(file))
    functions = {
        name: sorted({symbol for at in place.addresses for symbol in library.at(at)})
        for name, in_files in places.items()
        for place in in_files
        if place.library == file
    }
    return _Executed(library, {name: symbols for name, symbols in functions.items() if symbols})


def _engine_file(places: Places) -> str:
    """Return the engine's library: that of its step, or the one named so where none executes."""
    in_files = itertools.chain(places.get(ENGINE, ()), *places.values())
    for place in in_files:
        is_engine = place in places.get(ENGINE, ()) or Path(place.library).name.startswith(_PREFIX)
        if is_engine and place.addresses:
            return place.library
    raise MachineError(f"Callgrind does not say in which library {ENGINE} is")


@dataclass(frozen=True)
class _Executed:
    library: SharedLibrary
    functions: Mapping[str, Sequence[Symbol]]


def _engine_changes(old: _Executed, new: _Executed) -> CodeChanges:
    renamed = renamed_functions(_only_in(old, new), _only_in(new, old))
    callees = {
        source_name(before.name): source_name(after.name)
        for old_name, new_name in renamed.items()
        for before in old.functions[old_name]
        for after in new.functions[new_name]
    }
    old_names = {new_name: old_name for old_name, new_name in renamed.items()}
    changes = {
        name: _change(old, new, old_names.get(name, name), name, callees)
        for name in {**old.functions, **new.functions}
        if name not in renamed
    }
    return CodeChanges(changes, old_names)


def _only_in(one: _Executed, other: _Executed) -> dict[str, list[Instruction]]:
    """Return the code of the functions that only one library has, at least by that name."""
    return {
        name: _main_code(one.library, symbols)
        for name, symbols in one.functions.items()
        if name not in other.functions and not _has_twin(one.library, symbols, other.library)
    }


def _main_code(library: SharedLibrary, symbols: Sequence[Symbol]) -> list[Instruction]:
    return library.decoded(max(symbols, key=lambda symbol: symbol.size_bytes))


def _has_twin(library: SharedLibrary, symbols: Sequence[Symbol], other: SharedLibrary) -> bool:
    """Return whether another library has the same function, and not only one of its name."""
    code = _main_code(library, symbols)
    twins = map(other.decoded, _named_like(symbols, other))
    return any(_is_same(machine_code.similarity(code, twin), 1.0) for twin in twins)


def _named_like(symbols: Iterable[Symbol], library: SharedLibrary) -> list[Symbol]:
    names = {source_name(symbol.name) for symbol in symbols}
    return sorted({twin for name in names for twin in library.named(name)})


def _change(
    old: _Executed, new: _Executed, old_name: str, new_name: str, renamed: Mapping[str, str]
) -> CodeChange:
    """Return how the code of a function changed: that of the part that changed most."""
    old_parts, new_parts = old.functions.get(old_name, ()), new.functions.get(new_name, ())
    old_choices, new_choices = old_parts, new_parts
    if old_name == new_name:  # also parts that only one of the releases happens to execute
        old_choices, new_choices = (
            _named_like([*old_parts, *new_parts], library) for library in (old.library, new.library)
        )
    if not old_choices or not new_choices:
        return CodeChange.GONE if old_choices else CodeChange.NEW

    def least(before: Sequence[Symbol], after: Sequence[Symbol]) -> CodeChange:
        changes = [
            machine_code.compare(old.library.decoded(one), new.library.decoded(other), renamed)
            for one in before
            for other in after
        ]
        return min(changes, key=_SEVERITY.index)

    changes = [least([part], new_choices) for part in old_parts]
    changes += [least(old_choices, [part]) for part in new_parts]
    return max(changes, key=_SEVERITY.index)


def _file_changes(
    names: Iterable[str], baseline: Places, candidate: Places
) -> dict[str, CodeChange]:
    """Return how functions of libraries beside the engine's changed, by the files they are in."""
    old_files, new_files = (
        {place.library for in_files in places.values() for place in in_files if place.library}
        for places in (baseline, candidate)
    )
    changes = {}
    for name in names:
        files = {place.library for place in (*baseline.get(name, ()), *candidate.get(name, ()))}
        is_same = files <= old_files & new_files
        changes[name] = CodeChange.IDENTICAL if is_same else CodeChange.UNKNOWN
    return changes


def renamed_functions(gone: Codes, new: Codes) -> dict[str, str]:
    """Return the new names of functions by their old ones; a function has one of each."""
    pairs = [
        (
            machine_code.similarity(code, other),
            difflib.SequenceMatcher(None, name, new_name).ratio(),
            name,
            new_name,
        )
        for name, code in gone.items()
        for new_name, other in new.items()
        if min(len(code), len(other)) >= MIN_INSTRUCTIONS
    ]
    renamed: dict[str, str] = {}
    for similarity, similarity_of_names, name, new_name in sorted(pairs, reverse=True):
        is_free = name not in renamed and new_name not in renamed.values()
        if is_free and _is_same(similarity, similarity_of_names):
            renamed[name] = new_name
    return renamed


def _is_same(similarity: float, similarity_of_names: float) -> bool:
    """Return whether two functions are the same, however much the code changed."""
    is_like_named = similarity_of_names >= MIN_SIMILARITY_OF_NAMES
    return similarity >= (MIN_SIMILARITY_OF_LIKE_NAMES if is_like_named else MIN_SIMILARITY)
