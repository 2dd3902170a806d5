"""Whether an environment does the same again, and which fields differ where it does not.

Compared are what steps returned, without info, and the states of the simulation. Info is left out,
because wrappers put clocks into it.
"""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from mjbench.bounds import NonNegativeInt, PositiveInt
from mjbench.commands.env.recording import Recording
from mjbench.errors import one_line
from mjbench.simulation import compat

# How deep observations are nested, at most.
_MAX_DEPTH = 10
# Characters of a key of an observation that are shown, at most.
_LONGEST_KEY = 40
# Entries of an array that are named one by one, at most.
_NAMED_ENTRIES = 3
# An odd factor of 64 bits with no pattern (2^64 over the golden ratio), to mix bits with.
_FACTOR = np.uint64(0x9E3779B97F4A7C15)
_HALF = np.uint64(32)
# What a reset draws.
_DRAWN = ("time", "qpos", "qvel")


@dataclass(frozen=True)
class FieldDifference:
    """A field that was not the same in two passes with the same seeds and actions.

    Attributes:
      field: such as `observation`, `observation['arm']`, `reward` or `qpos`.
      is_physics: whether it belongs to the state of the simulation.
      entries: the first of its entries that differ, in the order of a flat array.
      count: of entries that differ.
      size: entries that it has.
    """

    field: str
    is_physics: bool
    entries: Sequence[NonNegativeInt]
    count: PositiveInt
    size: PositiveInt

    def __str__(self) -> str:
        if self.count == self.size:
            return self.field
        if self.count > len(self.entries):
            return f"{self.count} of {self.size} entries of {self.field}"
        return f"{self.field}[{', '.join(map(str, self.entries))}]"


class Fingerprint:
    """A number for each entry of each field, which depends on all values that the entry had."""

    def __init__(self) -> None:
        self._fields: dict[str, np.ndarray] = {}

    def add(self, field: str, value: Any, depth: int = 0) -> None:
        """Add a value of a field: a number, an array, or a container; else its type counts."""
        if depth > _MAX_DEPTH:
            return
        match value:
            case Mapping():
                for key in value:
                    name = one_line(repr(str(key)), _LONGEST_KEY)
                    self.add(f"{field}[{name}]", value[key], depth + 1)
            case list() | tuple():
                for i, each in enumerate(value):
                    self.add(f"{field}[{i}]", each, depth + 1)
            case _:
                self._mix(field, _bits(value))

    def _mix(self, field: str, bits: np.ndarray) -> None:
        before = self._fields.get(field)
        if before is None or before.shape != bits.shape:
            before = np.full(bits.shape, len(bits), dtype=np.uint64)
        mixed = (before ^ bits) * _FACTOR
        self._fields[field] = mixed ^ (mixed >> _HALF)

    def differences(self, other: "Fingerprint") -> list[FieldDifference]:
        """Return the fields whose values were not the same, bit by bit."""
        fields = dict.fromkeys([*self._fields, *other._fields])
        differences = (self._difference(field, other) for field in fields)
        return [difference for difference in differences if difference]

    def _difference(self, field: str, other: "Fingerprint") -> FieldDifference | None:
        mine, theirs = self._fields.get(field), other._fields.get(field)
        if mine is None or theirs is None or mine.shape != theirs.shape:
            return FieldDifference(field, False, (0,), 1, 1)
        return _difference(field, mine != theirs, is_physics=False)


def physics_differences(first: Recording, again: Recording) -> list[FieldDifference]:
    """Return the fields of the simulation that were not the same after all steps."""
    steps = list(zip(first.steps, again.steps, strict=True))
    if first.model is None or any((a and a.nstep) != (b and b.nstep) for a, b in steps):
        return [FieldDifference("the number of engine steps", True, (0,), 1, 1)]
    nstate = compat.state_size(first.model)
    differs = np.zeros(nstate, dtype=bool)
    for a, b in steps:
        if a and b and len(a.end) == len(b.end) == nstate:
            differs |= a.end.view(np.uint64) != b.end.view(np.uint64)
    columns = compat.state_columns(first.model)
    differences = (_difference(field, differs[columns[field]], True) for field in columns)
    return [difference for difference in differences if difference]


def left_by_reset(first: Recording, again: Recording) -> list[str]:
    """Return the fields that a reset leaves as they were, as the same seed tells.

    Positions, velocities and time are what a reset draws; what is written before a step is its own.
    """
    if first.model is None:
        return []
    columns = compat.state_columns(first.model)
    left: dict[str, None] = {}
    for a, b in zip(first.steps, again.steps, strict=True):
        if a is None or b is None or a.follows or b.follows or len(a.start) != len(b.start):
            continue
        own = {*_DRAWN, *a.entered, *b.entered, "ctrl"}
        for field, column in columns.items():
            same = np.array_equal(a.start[column].view(np.uint64), b.start[column].view(np.uint64))
            if field not in own and not same:
                left[field] = None
    return list(left)


def _difference(field: str, differs: np.ndarray, is_physics: bool) -> FieldDifference | None:
    entries = np.flatnonzero(differs)
    if not len(entries):
        return None
    named = entries[:_NAMED_ENTRIES].tolist()
    return FieldDifference(field, is_physics, named, len(entries), differs.size)


def _bits(value: Any) -> np.ndarray:
    """Return the bits of each number of an array; of anything else, those of its text or type."""
    array = np.asarray(value) if isinstance(value, np.ndarray | np.generic | float | int) else None
    if array is None or array.dtype.kind not in "biuf":
        text = value if isinstance(value, str) else type(value).__name__
        digest = hashlib.blake2b(text.encode(errors="replace"), digest_size=8).digest()
        return np.frombuffer(digest, dtype=np.uint64)
    if array.itemsize > np.dtype(np.uint64).itemsize:  # long double
        array = array.astype(float)
    flat = np.ascontiguousarray(array).ravel()
    return flat.view(f"u{flat.itemsize}").astype(np.uint64)
