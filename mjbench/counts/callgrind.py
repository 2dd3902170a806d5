"""Read what Callgrind counted: instructions by function, and by caller and callee."""

import re
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class CallgrindProfile:
    """What Callgrind counted between two dumps.

    Attributes:
      self_cost: instructions of each function itself.
      arcs: instructions of (caller, callee), all that the callee did included.
    """

    self_cost: Mapping[str, int]
    arcs: Mapping[tuple[str, str], int]

    @property
    def total(self) -> int:
        """Return all instructions."""
        return sum(self.self_cost.values())

    def inclusive(self, name: str) -> int:
        """Return the instructions of a function with all that it called."""
        return self.self_cost.get(name, 0) + sum(
            cost for (caller, callee), cost in self.arcs.items() if caller == name != callee
        )

    def below(self, root: str) -> list[tuple[str, int, int]]:
        """Return (name, self, inclusive) of what `root` reaches, the most self cost first."""
        callees: dict[str, set[str]] = defaultdict(set)
        for caller, callee in self.arcs:
            callees[caller].add(callee)
        reached, new = {root}, {root}
        while new:
            new = set().union(*(callees[name] for name in new)) - reached
            reached |= new
        rows = [(name, self.self_cost.get(name, 0), self.inclusive(name)) for name in reached]
        return sorted(rows, key=lambda row: (-row[1], row[0]))


def parse(text: str) -> CallgrindProfile:
    """Read a dump in Callgrind's format, version 1, with one event (instructions).

    A line is a position and a cost; the line after `calls=` is the cost of what was called. Names
    are written once, as `(id) name`, and by their id from then on (Valgrind manual, Callgrind
    Format Specification).
    """
    names: dict[str, str] = {}

    def name_of(word: str) -> str:
        found = re.match(r"\((\d+)\)(?: (.*))?$", word)
        if not found:
            return word
        if found[2] is not None:
            names[found[1]] = found[2]
        return names[found[1]]

    self_cost: dict[str, int] = defaultdict(int)
    arcs: dict[tuple[str, str], int] = defaultdict(int)
    function = callee = ""
    called = False
    for line in text.splitlines():
        if line.startswith("fn="):
            function = _plain(name_of(line[3:]))
        elif line.startswith("cfn="):
            callee = _plain(name_of(line[4:]))
        elif line.startswith("calls="):
            called = True
        elif line and (line[0].isdigit() or line[0] in "+-*"):
            cost = int(line.split()[1])
            if called:
                arcs[function, callee] += cost
                called = False
            else:
                self_cost[function] += cost
    return CallgrindProfile(dict(self_cost), dict(arcs))


def _plain(name: str) -> str:
    """Return a function's name without what the compiler and Callgrind append to it."""
    return re.sub(r"('\d+|\.(constprop|isra|part|cold|lto_priv|llvm)\.?\d*)+$", "", name)
