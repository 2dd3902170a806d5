"""`mjbench.timer`: how long a block of a program takes, such as a stepping loop.

    with mjbench.timer(data=data) as timer:
        for _ in range(1000):
            mujoco.mj_step(model, data)
            timer.lap()
    print(timer)

The clock is monotonic, and has the highest resolution that there is. The block is timed as it is;
a lap adds one reading of the clock to it.
"""

import html
import numbers
import time
from array import array
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from mjbench.errors import InputError, wrong_argument
from mjbench.formats import duration, plain

if TYPE_CHECKING:
    import mujoco
    import numpy as np

# Quantiles of laps that are shown.
_P50, _P99 = 0.5, 0.99


@dataclass(frozen=True, eq=False)
class Laps:
    """Parts of a block, each from the end of the one before, or from the start of the block.

    Attributes:
      ns: (count,) nanoseconds.
      p50_ns: half of them take no longer.
      p99_ns: 99 of 100 take no longer.
    """

    ns: "np.ndarray"
    p50_ns: float
    p99_ns: float
    max_ns: float

    @property
    def count(self) -> int:
        return len(self.ns)

    @property
    def quantiles(self) -> Sequence[tuple[str, str]]:
        """Names and durations of quantiles, for people."""
        figures = ("p50", self.p50_ns), ("p99", self.p99_ns), ("max", self.max_ns)
        return [(name, duration(ns)) for name, ns in figures]


@dataclass(frozen=True, eq=False)
class Timing:
    """How long a block took; None is what is not known."""

    elapsed_s: float
    steps: int | None = None
    simulated_s: float | None = None
    laps: Laps | None = None

    @property
    def steps_per_s(self) -> float | None:
        if self.steps is None or not self.elapsed_s:
            return None
        return self.steps / self.elapsed_s

    @property
    def realtime_factor(self) -> float | None:
        """Simulated seconds per second."""
        if self.simulated_s is None or not self.elapsed_s:
            return None
        return self.simulated_s / self.elapsed_s

    def __str__(self) -> str:
        if self.laps is None:
            return self._conclusion()
        quantiles = ", ".join(f"{name} {shown}" for name, shown in self.laps.quantiles)
        return f"{self._conclusion()}; {self.laps.count:,} laps: {quantiles}"

    def _conclusion(self) -> str:
        parts = [duration(1e9 * self.elapsed_s)]
        if self.steps is not None and self.steps_per_s is not None:
            parts.append(f"{self.steps:,} steps, {self.steps_per_s:,.0f} per second")
        if self.realtime_factor is not None:
            parts.append(f"{plain(self.realtime_factor, 3)} times real time")
        return ", ".join(parts)

    def _repr_html_(self) -> str:
        shown = f"<div>{html.escape(self._conclusion())}</div>"
        if self.laps is not None:
            cells = [("laps", f"{self.laps.count:,}"), *self.laps.quantiles]
            titles = "".join(f"<th>{title}</th>" for title, _ in cells)
            row = "".join(f"<td>{html.escape(cell)}</td>" for _, cell in cells)
            shown += f"<table><tr>{titles}</tr><tr>{row}</tr></table>"
        return f'<div class="mjbench">{shown}</div>'


class Timer:
    """Times the block of a `with` statement, once."""

    def __init__(
        self,
        steps: int | None = None,
        data: "mujoco.MjData | None" = None,
        clock: Callable[[], int] = time.perf_counter_ns,
    ):
        """See `timer`."""
        if not (data is None or isinstance(getattr(data, "time", None), numbers.Real)):
            raise wrong_argument("data", data, "an MjData")
        if not callable(clock):
            raise wrong_argument("clock", clock, "a function")
        self.steps, self._data, self._clock = steps, data, clock
        self._begin_ns: int | None = None
        self._end_ns: int | None = None
        self._begin_time_s = self._end_time_s = 0.0
        self._lap_ends_ns = array("q")

    def __enter__(self) -> "Timer":
        """Start the clock.

        Raises:
          InputError: it has timed a block before.
        """
        if self._begin_ns is not None:
            raise InputError("a timer times one block: call mjbench.timer() for another")
        if self._data is not None:
            self._begin_time_s = float(self._data.time)
        self._begin_ns = self._clock()
        return self

    def __exit__(self, *exception: object) -> None:
        self._end_ns = self._clock()
        if self._data is not None:
            self._end_time_s = float(self._data.time)

    def lap(self) -> None:
        """End a lap, and begin the next one.

        Raises:
          InputError: the clock does not run.
        """
        now_ns = self._clock()
        if self._begin_ns is None or self._end_ns is not None:
            raise InputError("a lap ends within the block of `with mjbench.timer()`")
        self._lap_ends_ns.append(now_ns)

    @property
    def steps(self) -> int | None:
        """Steps of the block; set it where they are known only at its end."""
        return self._steps

    @steps.setter
    def steps(self, steps: int | None) -> None:
        if not (steps is None or isinstance(steps, numbers.Integral)):
            raise wrong_argument("steps", steps, "a whole number")
        self._steps: int | None = steps

    @property
    def elapsed_s(self) -> float:
        """Seconds since the start, or of the whole block once it has ended.

        Raises:
          InputError: it has not begun.
        """
        begin_ns = self._begun_ns()
        end_ns = self._clock() if self._end_ns is None else self._end_ns
        return (end_ns - begin_ns) / 1e9

    @property
    def timing(self) -> Timing:
        """All that was timed.

        Raises:
          InputError: the block has not ended.
        """
        if self._end_ns is None:
            raise InputError("the block of `with mjbench.timer()` has not ended")
        steps, simulated_s = self._steps, self._simulated_s()
        timestep_s = self._timestep_s()
        if steps is None and simulated_s is not None and timestep_s:
            steps = round(simulated_s / timestep_s)
        return Timing(self.elapsed_s, steps, simulated_s, self._laps())

    def _simulated_s(self) -> float | None:
        """Return the simulated seconds: of the steps if their number is known, of data otherwise.

        A reset within the block turns back the time of data, and not the number of steps.
        """
        if self._data is None:
            return None
        timestep_s = self._timestep_s()
        if self._steps is not None and timestep_s:
            return self._steps * timestep_s
        passed_s = self._end_time_s - self._begin_time_s
        return passed_s if passed_s > 0 else None

    def _timestep_s(self) -> float | None:
        """Return the timestep of data's model; None in releases whose data do not name it."""
        model = getattr(self._data, "model", None)
        return None if model is None else float(model.opt.timestep)

    def _laps(self) -> Laps | None:
        if not self._lap_ends_ns:
            return None
        import numpy as np

        ends_ns = np.array(self._lap_ends_ns)
        ns = np.diff(ends_ns, prepend=self._begun_ns())
        ns.setflags(write=False)
        p50_ns, p99_ns = np.quantile(ns, (_P50, _P99))
        return Laps(ns, float(p50_ns), float(p99_ns), float(ns.max()))

    def _begun_ns(self) -> int:
        if self._begin_ns is None:
            raise InputError("the block of `with mjbench.timer()` has not begun")
        return self._begin_ns

    def __repr__(self) -> str:
        if self._begin_ns is None:
            return "<mjbench timer: not started>"
        if self._end_ns is None:
            return f"<mjbench timer: running for {duration(1e9 * self.elapsed_s)}>"
        return f"<mjbench timer: {self.timing}>"

    def __str__(self) -> str:
        return repr(self) if self._end_ns is None else str(self.timing)

    def _repr_html_(self) -> str:
        if self._end_ns is None:
            return f"<div>{html.escape(repr(self))}</div>"
        return self.timing._repr_html_()


def timer(
    steps: int | None = None,
    data: "mujoco.MjData | None" = None,
    *,
    clock: Callable[[], int] = time.perf_counter_ns,
) -> Timer:
    """Return a timer for the block of a `with` statement.

    Args:
      steps: that the block does, for steps per second; None to count them by `data`.
      data: that the block steps, for the real-time factor, and where `steps` is None for the number
        of steps: by how much its time advances. If the block resets it, give `steps`, too.
      clock: returns nanoseconds, and never less than before.
    """
    return Timer(steps, data, clock)
