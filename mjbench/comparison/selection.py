"""Which paths, with which options: what words of a command line name."""

from collections.abc import Mapping, Sequence
from typing import Any

from mjbench import paths
from mjbench.errors import InputError
from mjbench.instrument import machine
from mjbench.paths.accelerated import AcceleratedPath


def default_threads() -> list[int]:
    """Return the thread counts tried by default: one, and every usable core."""
    return sorted({1, machine.usable_cores()})


def variants(
    names: Sequence[str],
    threads: Sequence[int] | None = None,
    choices: Mapping[str, Sequence[Any]] | None = None,
) -> tuple[tuple[str, dict[str, Any]], ...]:
    """Return the variants of the named paths, the base path first (added if missing).

    Args:
      names: path names, or words for several (see `expanded`); empty for the C paths.
      threads: thread counts for every path that has them; None for the default ones.
      choices: further option values by option name.

    Raises:
      InputError: an unknown path.
    """
    counts = list(threads or default_threads())
    # Python threads and processes at one worker are the plain loop with a detour
    workers = counts if threads else [max(counts)]
    asked = expanded(names or ["c"])
    found = []
    for name in [paths.BASE, *(n for n in asked if n != paths.BASE)]:
        path = paths.find(name)
        values = dict(choices or {})
        values["threads"] = workers if name == "threads" else counts
        values["processes"] = workers
        found += [(name, options) for options in path.variants(values)]
    return tuple(found)


def expanded(words: Sequence[str]) -> list[str]:
    """Return the paths that words name; `c` is all C paths, `usual` those and MJX if installed."""
    found: list[str] = []
    for word in words:
        if word in ("c", "usual"):
            found += [n for n in paths.registry() if not compiles(n)]
            found += [n for n in paths.registry() if word == "usual" and _usual(n)]
        else:
            found.append(word)
    return list(dict.fromkeys(found))


def rivals(names: Sequence[str]) -> list[str]:
    """Return the C paths that a sweep of compiled paths is to overtake, if it names none."""
    compiled = [name for name in names if compiles(name)]
    if compiled and not set(names) - {*compiled, paths.BASE}:
        return [n for n, p in paths.registry().items() if "threads" in {o.name for o in p.options}]
    return []


def compiles(name: str) -> bool:
    """Return whether a path compiles first, and has a process of its own for it."""
    return paths.find(name).compiles


def _usual(name: str) -> bool:
    path = paths.find(name)
    return isinstance(path, AcceleratedPath) and path.usual and path.unavailable() is None


def choices(words: Sequence[str], names: Sequence[str]) -> dict[str, list[Any]]:
    """Return option values by option name from words such as `pool=new,kept`.

    Args:
      words: of the command line.
      names: of paths that may be the user's own.

    Raises:
      InputError: no such option, or a value that it cannot have.
    """
    known = {
        option.name: option
        for name in [*paths.registry(), *names]
        for option in paths.find(name).options
    }
    found = {}
    for word in words:
        name, equals, values = word.partition("=")
        if not equals or name not in known:
            raise InputError(f"--option {word}: give NAME=VALUE, NAME one of {', '.join(known)}")
        found[name] = [known[name].value(value) for value in values.split(",")]
    return found
