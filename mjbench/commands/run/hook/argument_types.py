"""Which argument differs where JAX compiles a function again.

JAX compiles a function once for each type of its arguments: their dtypes, shapes, weak types,
whether they are committed to a device, and the values of those that are static. This module runs in
the user's program.
"""

import inspect
import sys
from collections.abc import Callable, Mapping, Sequence
from typing import Any

# How an argument differs.
WEAK_TYPE, DTYPE, SHAPE, DEVICE, VALUE = "weak type", "dtype", "shape", "device", "value"
# Arguments that are named, and characters of one's value.
_MOST_NAMED, _MOST_TEXT = 3, 40

# Of a leaf: dtype, shape, whether its type is weak; None of each for what is no array. Its value as
# text, where it is an object of Python. Whether it is committed to a device.
_Leaf = tuple[str | None, Sequence[int] | None, bool | None, str, bool]
# Name of an argument or its field, how it differs, what it was, and what it is.
Change = tuple[str, str, str, str]


class ArgumentTypes:
    """The types of the arguments for which one function was compiled."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self._function = function
        self._compiled: list[dict[str, _Leaf]] = []

    def note_compiled(
        self, args: Sequence[Any], kwargs: Mapping[str, Any]
    ) -> Sequence[Change] | None:
        """Return how arguments differ from the most similar ones of an earlier compilation.

        None if there was none, or if another function calls this one while JAX traces it.
        """
        leaves = self._leaves(args, kwargs)
        if leaves is None:
            return None
        nearest = min(
            (_changes(earlier, leaves) for earlier in self._compiled), key=len, default=None
        )
        self._compiled.append(leaves)
        return nearest if nearest is None else nearest[:_MOST_NAMED]

    def _leaves(self, args: Sequence[Any], kwargs: Mapping[str, Any]) -> dict[str, _Leaf] | None:
        jax = sys.modules["jax"]
        try:
            arguments = inspect.signature(self._function).bind(*args, **kwargs).arguments
        except (TypeError, ValueError):
            arguments = {"arguments": (args, kwargs)}
        leaves: dict[str, _Leaf] = {}
        for name, value in arguments.items():
            for path, leaf in jax.tree_util.tree_flatten_with_path(value)[0]:
                if isinstance(leaf, jax.core.Tracer):
                    return None
                leaves[name + jax.tree_util.keystr(path)] = _leaf(jax, leaf)
        return leaves


def _leaf(jax: Any, leaf: Any) -> _Leaf:
    is_array = hasattr(leaf, "shape")
    text = "" if is_array else repr(leaf)[:_MOST_TEXT]
    try:
        kind = jax.typeof(leaf) if hasattr(jax, "typeof") else jax.core.get_aval(leaf)
        is_committed = bool(getattr(leaf, "_committed", False))
        return str(kind.dtype), tuple(kind.shape), bool(kind.weak_type), text, is_committed
    except (TypeError, AttributeError):  # no array of JAX
        return None, None, None, text, False


def _changes(before: Mapping[str, _Leaf], now: Mapping[str, _Leaf]) -> list[Change]:
    """Return how leaves differ; those of which only a value does, where nothing else differs."""
    of_type, of_value = list[Change](), list[Change]()
    for name in {**before, **now}:
        old, new = before.get(name), now.get(name)
        if old == new:
            continue
        if old is None or new is None or old[0] is None or new[0] is None:
            of_type.append((name, VALUE, _shown(old), _shown(new)))
            continue
        for kind, position in ((DTYPE, 0), (SHAPE, 1), (DEVICE, 4), (WEAK_TYPE, 2)):
            if old[position] != new[position]:
                moves = old[4] != new[4]
                of_type.append((name, kind, _shown(old, moves), _shown(new, moves)))
                break
        else:
            of_value.append((name, VALUE, old[3], new[3]))
    return of_type or of_value


def _shown(leaf: _Leaf | None, with_device: bool = False) -> str:
    if leaf is None:
        return "absent"
    dtype, shape, is_weak, text, is_committed = leaf
    if dtype is None or shape is None:
        return text
    device = f"{'' if is_committed else 'un'}committed " if with_device else ""
    return f"{'weakly typed ' if is_weak else ''}{device}{dtype}[{','.join(map(str, shape))}]"
