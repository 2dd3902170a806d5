"""What calls of a function returned, in a form that two processes can compare.

A revision's own classes exist in its process alone, so results travel as arrays and texts.
"""

import dataclasses
import hashlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from mjbench.paired.outcomes import ResultsOutcome

# A smaller difference is rounding, as a share of the largest magnitude: the order of additions
# changed. For numbers of 64 bits, and for shorter ones.
ROUNDING, SHORT_ROUNDING = 1e-9, 1e-5
# A magnitude that is smaller counts as this one: what cancels to zero leaves rounding.
_LEAST_MAGNITUDE = 1e-6
# Larger arrays are compared by a digest, bit by bit.
_MOST_BYTES = 1 << 24
_UNKNOWN = "other bits, in an array that is too large to tell rounding from change"
# Containers within containers, at most.
_DEPTH = 20
# Of MjData, what a step leaves.
_DATA_FIELDS = ("time", "qpos", "qvel", "act", "qacc", "ctrl", "sensordata", "xpos")


@dataclass(frozen=True)
class LargeArray:
    """An array that is too large to be sent."""

    dtype: str
    shape: tuple[int, ...]
    digest: str


_Value = np.ndarray | LargeArray | str


@dataclass(frozen=True, eq=False)
class Leaf:
    """A part of a result; `place` is within it, such as `[0].qpos`, and empty for the whole."""

    place: str
    value: _Value


@dataclass(frozen=True)
class ResultsDifference:
    """How the results of two processes compare."""

    outcome: ResultsOutcome
    detail: str = ""

    @property
    def is_changed(self) -> bool | None:
        """Whether they are of different work; None where that is not known."""
        if self.outcome in (ResultsOutcome.NONE, ResultsOutcome.RANDOM):
            return None
        return self.outcome == ResultsOutcome.DIFFERENT


def leaves(result: object) -> list[Leaf]:
    """Return the parts of what a call returned; TypeError where one cannot be compared."""
    return [] if result is None else list(_leaves("", result, _DEPTH))


def _leaves(place: str, value: Any, depth: int) -> Iterator[Leaf]:
    if depth == 0:
        raise TypeError("containers lie too deep in each other")
    if value is None or isinstance(value, str | bytes):
        yield Leaf(place, repr(value))
    elif isinstance(value, Mapping):
        for key in sorted(value, key=repr):
            yield from _leaves(f"{place}[{key!r}]", value[key], depth - 1)
    elif isinstance(value, list | tuple) and not _is_vector(value):
        yield Leaf(place, f"{len(value)} parts")
        for number, part in enumerate(value):
            yield from _leaves(f"{place}[{number}]", part, depth - 1)
    elif dataclasses.is_dataclass(value) and not isinstance(value, type):
        for each in dataclasses.fields(value):
            yield from _leaves(f"{place}.{each.name}", getattr(value, each.name), depth - 1)
    elif type(value).__name__ == "MjData":
        for name in _DATA_FIELDS:
            yield from _leaves(f"{place}.{name}", getattr(value, name), depth - 1)
    else:
        yield Leaf(place, _array(value))


def _is_vector(values: Sequence[Any]) -> bool:
    """Return whether a sequence is numbers alone, so that it is one part."""
    return bool(values) and all(isinstance(value, int | float) for value in values)


def _array(value: Any) -> np.ndarray | LargeArray:
    array = np.array(value)  # a copy: a later call may write to the same memory
    if array.dtype.kind not in "biufc":
        raise TypeError(f"{type(value).__name__} is no number, text, array or container of them")
    if array.nbytes <= _MOST_BYTES:
        return array
    digest = hashlib.blake2b(np.ascontiguousarray(array).tobytes(), digest_size=16).hexdigest()
    return LargeArray(array.dtype.str, array.shape, digest)


def compare(
    baseline: Sequence[Sequence[Leaf]], candidate: Sequence[Sequence[Leaf]]
) -> ResultsDifference:
    """Return how the results of the first calls of both compare, call by call."""
    if not any(baseline) and not any(candidate):
        return ResultsDifference(ResultsOutcome.NONE, "the function returns nothing")
    largest, unknown = 0.0, ""
    for number, (old, new) in enumerate(zip(baseline, candidate, strict=True), 1):
        if [leaf.place for leaf in old] != [leaf.place for leaf in new]:
            return _different(number, "its parts are others")
        for old_leaf, new_leaf in zip(old, new, strict=True):
            place = f"{old_leaf.place.lstrip('.')}: " if old_leaf.place else ""
            difference, text = _difference(old_leaf.value, new_leaf.value)
            if text:
                return _different(number, f"{place}{text}")
            if difference is None:
                unknown = unknown or f"call {number} returns {place}{_UNKNOWN}"
            else:
                largest = max(largest, difference)
    if unknown:
        return ResultsDifference(ResultsOutcome.NONE, unknown)
    if largest:
        return ResultsDifference(ResultsOutcome.ROUNDING, f"they differ by {largest:.0e} at most")
    return ResultsDifference(ResultsOutcome.SAME)


def _different(number: int, text: str) -> ResultsDifference:
    return ResultsDifference(ResultsOutcome.DIFFERENT, f"call {number} returns {text}")


def _difference(old: _Value, new: _Value) -> tuple[float | None, str]:
    """Return by what share two values differ, and how where that is more than rounding.

    The share is None where it is not known.
    """
    if isinstance(old, str) or isinstance(new, str):
        return 0.0, "" if isinstance(new, str) and old == new else _change(old, new)
    if old.shape != new.shape:
        return 0.0, f"shape {new.shape} instead of {old.shape}"
    if isinstance(old, LargeArray) and isinstance(new, LargeArray):
        if old == new:
            return 0.0, ""
        are_whole = np.dtype(old.dtype).kind in "biu" and old.dtype == new.dtype
        return None, "other whole numbers" if are_whole and old.digest != new.digest else ""
    if isinstance(old, LargeArray) or isinstance(new, LargeArray):
        return None, ""
    if np.array_equal(old, new, equal_nan=old.dtype.kind in "fc" and new.dtype.kind in "fc"):
        return 0.0, ""
    exact = old.dtype.kind in "biu" and new.dtype.kind in "biu"
    first, second = old.astype(complex), new.astype(complex)
    is_number = np.isfinite(first) & np.isfinite(second)
    other = ~is_number & ~((first == second) | (np.isnan(first) & np.isnan(second)))
    distances = np.where(is_number, np.abs(first - second), 0.0)
    scale = float(np.abs(np.where(is_number, first, 0.0)).max(initial=0.0))
    share = float(distances.max(initial=0.0)) / max(scale, _LEAST_MAGNITUDE)
    short = min(old.dtype.itemsize, new.dtype.itemsize) < 8
    if not exact and not other.any() and share <= (SHORT_ROUNDING if short else ROUNDING):
        return share, ""
    index = np.unravel_index(int(np.argmax(np.where(other, np.inf, distances))), old.shape)
    at = f"[{', '.join(map(str, index))}] " if index else ""
    return share, f"{at}{new[index]} instead of {old[index]}"


def _change(old: _Value, new: _Value) -> str:
    old_text, new_text = (
        value if isinstance(value, str) else f"an array of shape {value.shape}"
        for value in (old, new)
    )
    return f"{new_text[:60]} instead of {old_text[:60]}"
