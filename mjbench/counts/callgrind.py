"""Read Callgrind's dumps: instructions by function, and by pair of caller and callee.

A dump is text, a section for each function (Valgrind manual, "Callgrind Format Specification"):

    ob=(3) /a/libmujoco.so  the file whose code the functions below are
    fn=(7) mj_step          the function that the lines below belong to
    20 100                  in line 20, it executed 100 instructions itself
    +1 50                   and 50 one line further on
    cob=(3)                 in this file
    cfn=(8) mj_forward      it called this function,
    calls=2 30              twice, at the callee's line;
    * 850                   from the line before; all that the callee did cost 850 instructions

A name is written out once, with an id, and later stands as the id alone. Lines for source files
(`fl=`, …) and most of the header say nothing about cost and are skipped.

The *self cost* of a function is what it executed itself. Its *inclusive cost* adds what the
functions that it called executed, directly or through others.
"""

import re
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property

from mjbench.counts.records import FunctionCount
from mjbench.errors import MachineError, describe

# What follows `operator` in the name of one. Longer signs come first, and a template's bracket may
# follow without a space: `operator>><char>`.
_OPERATOR = re.compile(
    r"\(\)|\[\]|<=>|->\*|->|<<=|>>=|<<|>>|&&|\|\||\+\+|--|[-+*/%^&|!=<>]=|[-+*/%^&|~!=<>,]"
    r"|[ ]?(new|delete)(\[\])?"
)


@dataclass(frozen=True)
class CallgrindProfile:
    """The content of one dump.

    Attributes:
      arcs: instructions of each (caller, callee), with all that the callee called.
      libraries: a file that has the code of each function, by name; empty where Callgrind knows
        none.
    """

    self_cost: Mapping[str, int]
    arcs: Mapping[tuple[str, str], int]
    libraries: Mapping[str, str]

    def __add__(self, other: "CallgrindProfile") -> "CallgrindProfile":
        return CallgrindProfile(
            Counter(self.self_cost) + Counter(other.self_cost),
            Counter(self.arcs) + Counter(other.arcs),
            {**other.libraries, **self.libraries},
        )

    @property
    def total(self) -> int:
        return sum(self.self_cost.values())

    @cached_property
    def inclusive_cost(self) -> Counter[str]:
        """Instructions of each function with all that it called, by name.

        Calls of itself are left out: the outermost call already includes them.
        """
        inclusive = Counter(self.self_cost)
        for (caller, callee), cost in self.arcs.items():
            if caller != callee:
                inclusive[caller] += cost
        return inclusive

    def counts(self, names: Iterable[str], repeats: int) -> list[FunctionCount]:
        """Return what functions cost in one of `repeats` equal pieces of work, costliest first."""
        own, inclusive = self.self_cost, self.inclusive_cost
        counts = [FunctionCount(n, own.get(n, 0) / repeats, inclusive[n] / repeats) for n in names]
        return sorted(counts, key=lambda count: (-count.self, count.name))

    def reachable_from(self, root: str) -> set[str]:
        callees: dict[str, set[str]] = defaultdict(set)
        for caller, callee in self.arcs:
            callees[caller].add(callee)
        reached, frontier = {root}, {root}
        while frontier:
            frontier = set().union(*(callees[name] for name in frontier)) - reached
            reached |= frontier
        return reached


def parse(text: str) -> CallgrindProfile:
    """Return the profile in a dump of one event, version 1; MachineError for anything else."""
    try:
        return _parse(text)
    except (ValueError, LookupError) as error:
        raise MachineError(f"cannot read what Callgrind wrote: {describe(error)}") from error


def _parse(text: str) -> CallgrindProfile:
    # Callgrind writes `???` where it knows no file
    functions, libraries = _Names(source_name), _Names(lambda name: name if name.strip("?") else "")
    self_cost: dict[str, int] = defaultdict(int)
    arcs: dict[tuple[str, str], int] = defaultdict(int)
    library_of: dict[str, str] = {}
    function = callee = library = ""
    is_call_cost = False
    for line in text.splitlines():
        key, _, value = line.partition("=")
        if key == "fn":
            function = functions.read(value)
        elif key == "cfn":
            callee = functions.read(value)
        elif key == "ob":
            library = libraries.read(value)
        elif key == "cob":
            libraries.read(value)
        elif key == "calls":
            is_call_cost = True
        elif line and (line[0].isdigit() or line[0] in "+-*"):
            _, cost = line.split()
            if is_call_cost:
                arcs[function, callee] += int(cost)
            else:
                self_cost[function] += int(cost)
                library_of.setdefault(function, library)
            is_call_cost = False
    return CallgrindProfile(dict(self_cost), dict(arcs), library_of)


class _Names:
    def __init__(self, normal: Callable[[str], str]):
        self._normal = normal
        self._full: dict[str, str] = {}

    def read(self, value: str) -> str:
        match = re.match(r"\((\d+)\)(?: (.*))?$", value)
        if not match:
            return self._normal(value)
        identifier, name = match.groups()
        if name is not None:
            self._full[identifier] = name
        return self._normal(self._full[identifier])


def source_name(name: str) -> str:
    """Return a function's name as in its source, without the types of C++.

    Callgrind appends the depth of a recursion (`'2`), the compiler the kind of a clone
    (`.constprop.0`). Of C++, types of arguments, of results and of templates are left out, so that
    overloads and instances have one name: `std::vector<int> f::read<int>(char*)` is `f::read`. So
    are versions of the standard library (`[abi:ne200100]`).
    """
    name = re.sub(r"('\d+|\.(constprop|isra|part|cold|lto_priv|llvm)\.?\d*)+$", "", name)
    name = re.sub(r"\[abi:\w+\]", "", name)
    name = name.replace("(anonymous namespace)", "{anonymous}")
    is_typed = "(" in name[1:] and name[0] not in "(_0123456789"
    return _without_types(name) if is_typed else name


def _without_types(name: str) -> str:
    name = name.replace("std::__1::", "std::")
    # of an operator such as `operator()` or `operator<<` the signs belong to the name
    before, operator, signs = name.partition("operator")
    match = _OPERATOR.match(signs)
    symbol = match.group() if operator and match else ""
    rest = signs[len(symbol) :] if symbol else operator + signs
    before, rest = _without_brackets(before), _without_brackets(rest)
    plain = (before + operator + symbol if symbol else before) + rest
    plain = plain.removesuffix(" const").strip()
    beginning, space, end = plain.rpartition(" ")
    is_operator = beginning.endswith("operator")  # such as `operator new`
    return beginning.rpartition(" ")[2] + space + end if is_operator else end


def _without_brackets(text: str) -> str:
    depth, characters = 0, []
    for character in text:
        if character in "(<":
            depth += 1
        if depth == 0:
            characters.append(character)
        if character in ")>":
            depth -= 1
    return "".join(characters)
