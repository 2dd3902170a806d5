"""The cells that wait to be measured, so sorted that a hand-out looks at few of them.

They keep their order. Cells that one command measures together form a group; the groups are sorted
by the machine that may measure them, and by whether that must be quiet. Cells that failed before
come after all others, each alone.
"""

import itertools
from collections import Counter, deque
from collections.abc import Iterable, Iterator, Sequence

from mjbench.sweep.cells import Cell
from mjbench.sweep.commands import COMMANDS

# A label, or none, and whether the machine must be quiet.
_Sort = tuple[str, bool]


class Waiting:
    """Cells that wait."""

    def __init__(self, cells: Iterable[Cell]):
        """Take cells, each once, in the order in which they are to be measured."""
        # of each cell its place in the order, beside it
        self._groups: dict[_Sort, dict[tuple[str, ...], deque[tuple[int, Cell]]]] = {}
        self._counts: Counter[_Sort] = Counter()
        self._failed: list[Cell] = []
        self._first = 0
        for place, cell in enumerate(cells):
            self._group(cell).append((place, cell))
            self._counts[_sort(cell)] += 1

    def __len__(self) -> int:
        """Return how many wait."""
        return self._counts.total() + len(self._failed)

    def __iter__(self) -> Iterator[Cell]:
        """Yield the cells in their order."""
        groups = (group for of_sort in self._groups.values() for group in of_sort.values())
        for _, cell in sorted((item for group in groups for item in group), key=lambda it: it[0]):
            yield cell
        yield from self._failed

    @property
    def failed(self) -> Sequence[Cell]:
        """Those that failed before, in their order."""
        return self._failed

    def labels(self) -> set[str]:
        """Return the labels of machines that cells need; cells that need none have no part."""
        fresh = {label for (label, _), count in self._counts.items() if count}
        return (fresh | {cell.machine for cell in self._failed}) - {""}

    def count(self, label: str, needs_quiet: bool) -> int:
        """Return how many cells that have not failed a machine with this label may measure."""
        return sum(self._counts[sort] for sort in {(label, needs_quiet), ("", needs_quiet)})

    def next_together(self, label: str, needs_quiet: bool, most: int) -> tuple[Cell, ...]:
        """Return the next cells that have not failed and that one command measures."""
        sorts = {(label, needs_quiet), ("", needs_quiet)}
        groups = [group for sort in sorts for group in self._groups.get(sort, {}).values()]
        if not groups:
            return ()
        first = min(groups, key=lambda group: group[0][0])
        return tuple(cell for _, cell in itertools.islice(first, most))

    def take(self, cells: Sequence[Cell]) -> None:
        """Take away what `next_together` returned, or one of `failed`."""
        if cells[0] in self._failed:
            self._failed.remove(cells[0])
            return
        sort, key = _sort(cells[0]), _key(cells[0])
        group = self._groups[sort][key]
        for cell in cells:
            _, first = group.popleft()
            assert first == cell, "the first of a group are taken"
        self._counts[sort] -= len(cells)
        if not group:
            del self._groups[sort][key]

    def put_first(self, cells: Sequence[Cell]) -> None:
        """Have cells that have not failed measured next."""
        for cell in reversed(cells):
            self._first -= 1
            self._group(cell).appendleft((self._first, cell))
            self._counts[_sort(cell)] += 1

    def put_last(self, cells: Iterable[Cell]) -> None:
        """Have cells that failed measured last."""
        self._failed += cells

    def _group(self, cell: Cell) -> deque[tuple[int, Cell]]:
        return self._groups.setdefault(_sort(cell), {}).setdefault(_key(cell), deque())


def _sort(cell: Cell) -> _Sort:
    return cell.machine, COMMANDS[cell.kind].needs_quiet


def _key(cell: Cell) -> tuple[str, ...]:
    """Return what the cells of one command have in common."""
    return (cell.kind, *COMMANDS[cell.kind].together(cell))
