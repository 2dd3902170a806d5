"""Read Callgrind's dumps: instructions by function, and by pair of caller and callee.

A dump is text, a section for each function (Valgrind manual, "Callgrind Format Specification"):

    fn=(7) mj_step          the function that the lines below belong to
    20 100                  at line 20, the function itself executed 100 instructions
    +1 50                   and 50 one line further on
    cfn=(8) mj_forward      it called this function,
    calls=2 30              twice, at the callee's line 30;
    * 850                   from the line before, and all that the callee did cost 850 instructions

A name is written out once, with an id, and later stands as the id alone. Lines for source and
object files (`fl=`, `ob=`, …) and the header say nothing about cost and are skipped.

The *self cost* of a function is what it executed itself. Its *inclusive cost* adds what the
functions that it called executed, directly or through others.
"""

import re
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass

from mjbench.errors import MachineError, describe


@dataclass(frozen=True)
class FunctionCost:
    """What one function cost, in instructions.

    Attributes:
      name: of the function.
      self_cost: executed by the function itself.
      inclusive_cost: the same with all that it called.
    """

    name: str
    self_cost: int
    inclusive_cost: int


@dataclass(frozen=True)
class CallgrindProfile:
    """The content of one dump.

    Attributes:
      self_cost: instructions that each function executed itself, by name.
      arcs: instructions of each (caller, callee), with all that the callee called.
    """

    self_cost: Mapping[str, int]
    arcs: Mapping[tuple[str, str], int]

    @property
    def total(self) -> int:
        """All instructions of the dump."""
        return sum(self.self_cost.values())

    def inclusive(self, name: str) -> int:
        """Return the instructions of a function with all that it called.

        Calls of itself are left out: the outermost call already includes them.
        """
        return self.self_cost.get(name, 0) + sum(
            cost for (caller, callee), cost in self.arcs.items() if caller == name != callee
        )

    def reachable_from(self, root: str) -> list[FunctionCost]:
        """Return the functions that `root` calls, directly or not, and itself; costliest first."""
        callees: dict[str, set[str]] = defaultdict(set)
        for caller, callee in self.arcs:
            callees[caller].add(callee)
        reached, frontier = {root}, {root}
        while frontier:
            frontier = set().union(*(callees[name] for name in frontier)) - reached
            reached |= frontier
        costs = [
            FunctionCost(name, self.self_cost.get(name, 0), self.inclusive(name))
            for name in reached
        ]
        return sorted(costs, key=lambda cost: (-cost.self_cost, cost.name))


def parse(text: str) -> CallgrindProfile:
    """Return the profile in a dump.

    Args:
      text: a dump in Callgrind's format, version 1, of one event (instructions executed).

    Raises:
      MachineError: it is something else, or was cut short.
    """
    try:
        return _parse(text)
    except (ValueError, LookupError) as error:
        raise MachineError(f"cannot read what Callgrind wrote: {describe(error)}") from error


def _parse(text: str) -> CallgrindProfile:
    full_names: dict[str, str] = {}
    self_cost: dict[str, int] = defaultdict(int)
    arcs: dict[tuple[str, str], int] = defaultdict(int)
    function = callee = ""
    is_call_cost = False
    for line in text.splitlines():
        key, _, value = line.partition("=")
        if key == "fn":
            function = _function_name(value, full_names)
        elif key == "cfn":
            callee = _function_name(value, full_names)
        elif key == "calls":
            is_call_cost = True
        elif line and (line[0].isdigit() or line[0] in "+-*"):
            cost = int(line.split()[1])
            if is_call_cost:
                arcs[function, callee] += cost
            else:
                self_cost[function] += cost
            is_call_cost = False
    return CallgrindProfile(dict(self_cost), dict(arcs))


def _function_name(value: str, full_names: dict[str, str]) -> str:
    """Return the function that `(id) name`, `(id)` or `name` stands for.

    Args:
      value: as the dump writes it.
      full_names: by id, of the lines so far; this one is added.
    """
    match = re.match(r"\((\d+)\)(?: (.*))?$", value)
    if not match:
        return _source_name(value)
    identifier, name = match.groups()
    if name is not None:
        full_names[identifier] = name
    return _source_name(full_names[identifier])


def _source_name(name: str) -> str:
    """Return a function's name as in its source.

    Callgrind appends the depth of a recursion (`'2`), the compiler the kind of a clone
    (`.constprop.0`).
    """
    return re.sub(r"('\d+|\.(constprop|isra|part|cold|lto_priv|llvm)\.?\d*)+$", "", name)
