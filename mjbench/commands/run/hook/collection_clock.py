"""How many garbage collections there are, and how long they take."""

import itertools
import operator
from collections import deque
from collections.abc import Callable
from functools import partial
from typing import Any


class CollectionClock:
    """Times garbage collections by functions of C alone.

    Python drops an exception that is raised in `gc.callbacks`. The program's signal handlers, such
    as that of Ctrl-C, run in whatever function of Python runs at that moment, and raise there. A
    callback without one never runs them: they run in the program, right after the collection.

    Attributes:
      callback: for `gc.callbacks`; it times nothing before `begin`.
    """

    def __init__(self, now_ns: Callable[[], int]) -> None:
        self._now_ns = now_ns
        self._phases = type("Phases", (), {})
        # Python calls it with "start" and with "stop": both are properties
        self.callback: Callable[[str, Any], Any] = partial(getattr, self._phases())

    def begin(self, write: Callable[[int, int, int], None]) -> None:
        """Count from now on.

        Args:
          write: a function of C, called after each collection with how many there were, the ns that
            they took, and the ns of the longest.
        """
        begin_ns = deque([self._now_ns()], maxlen=1)
        starts = itertools.filterfalse(begin_ns.append, iter(self._now_ns, None))
        begins_ns = map(begin_ns.__getitem__, itertools.repeat(0))
        durations_ns = map(operator.sub, iter(self._now_ns, None), begins_ns)
        to_add, to_compare = itertools.tee(durations_ns)
        sums_ns, longest_ns = itertools.accumulate(to_add), itertools.accumulate(to_compare, max)
        stops = itertools.starmap(write, zip(itertools.count(1), sums_ns, longest_ns, strict=False))
        write(0, 0, 0)
        self._set(partial(next, starts), partial(next, stops))

    def end(self) -> None:
        self._set(None, None)

    def _set(self, on_start: Any, on_stop: Any) -> None:
        for phase, function in (("start", on_start), ("stop", on_stop)):
            setattr(self._phases, phase, property(function))
