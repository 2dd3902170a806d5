"""What the step clock noted: how long steps and iterations take, and what the clock cost.

`hook/step_clock.py` writes the files; `hook/step_file.py` defines their format.
"""

import contextlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import msgspec
import numpy as np

from mjbench.bounds import AnyFloat, NonNegativeFloat, NonNegativeInt, Share
from mjbench.commands.profile import step_parts
from mjbench.commands.run.hook import step_file
from mjbench.errors import InputError

# The longest of the engine's timers, as a share of the time of the same steps. The program may have
# reset the timers in some of them.
LEAST_TIMER_SHARE, MOST_TIMER_SHARE = 1e-3, 1.1

# An iteration is late that takes so many medians.
_LATE = 1.5
# Parts, in the order of time, whose means say how much a mean varies: iterations of one part are
# often slow together.
_PARTS = 10
_RECORDS = np.dtype([(name, "<i8") for name in ("kind", "thread", "begin", "end", "nstep", "dt")])


@dataclass(frozen=True)
class Header:
    """What stands before the records, in the order of the file.

    Attributes:
      first_ns: when the first call began, on the clock of `time.perf_counter_ns`; 0 before it.
      cost_ns: what the clock cost the program, as calibrated.
      timed_ns: what it cost for each call that has a record.
      process_ns: when the process began, on the same clock.
    """

    pid: int
    first_ns: int
    last_ns: int
    calls_passed: int
    cost_ns: int
    timed_ns: int
    process_ns: int
    collections: int
    collections_ns: int
    longest_collection_ns: int


@dataclass(frozen=True)
class Engine:
    """The MuJoCo that a program used."""

    version: str = ""
    timers: Mapping[str, int] = field(default_factory=dict)
    warnings: Mapping[int, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Durations:
    """How long something takes, in ns.

    Attributes:
      count: how many were timed.
      p50_ns: the median.
      p99_ns: what 99 % do not exceed.
      max_ns: the longest.
      late: how many took longer than `late_ns`.
      early_ns, end_ns: medians of the first tenth, and of the last.
      mean_error: standard error of the mean, as a share of it; 0 of few.
    """

    count: NonNegativeInt
    p50_ns: NonNegativeFloat
    p99_ns: NonNegativeFloat
    max_ns: NonNegativeFloat
    late: NonNegativeInt = 0
    early_ns: NonNegativeFloat = 0.0
    end_ns: NonNegativeFloat = 0.0
    mean_error: NonNegativeFloat = 0.0

    @property
    def late_ns(self) -> float:
        return _LATE * self.p50_ns

    @classmethod
    def of(cls, durations_ns: np.ndarray) -> "Durations | None":
        """Return the quantiles of (count,) ns in the order of time; None of nothing."""
        if not len(durations_ns):
            return None
        p50, p99 = np.quantile(durations_ns, [0.5, 0.99], method="higher")
        tenth = max(1, len(durations_ns) // 10)
        means = [part.mean() for part in np.array_split(durations_ns, _PARTS) if len(part)]
        has_parts = len(means) == _PARTS and sum(means) > 0
        return cls(
            count=len(durations_ns),
            p50_ns=float(p50),
            p99_ns=float(p99),
            max_ns=float(durations_ns.max()),
            late=int((durations_ns > _LATE * p50).sum()),
            early_ns=float(np.median(durations_ns[:tenth])),
            end_ns=float(np.median(durations_ns[-tenth:])),
            mean_error=float(np.std(means, ddof=1) / np.mean(means) / _PARTS**0.5)
            if has_parts
            else 0.0,
        )


@dataclass(frozen=True)
class StepTimes:
    """The steps of one process.

    Attributes:
      pid: the process.
      span_s: seconds from the first call of the engine to the last.
      nstep: steps in that time, of all threads.
      steps_per_s: steps per second of wall time; None without a step.
      real_time_factor: simulated seconds per second of wall time; None without a step.
      step: a call of the engine, divided by its steps; None without one.
      iteration: from the begin of one step of the environment to the next, or from one call of the
        engine to the next; None without two of them.
      of_environment: whether iterations are steps of an environment.
      stages: share of a step by stage, from the engine's timers; empty where it has no clock.
      cost_share: what the step clock cost, as a share of `span_s`.
      collections: garbage collections of the process, from the first call on.
      collections_s: seconds that they took.
      longest_collection_s: the longest.
      startup_s: from the begin of Python to the first call of the engine.
    """

    pid: NonNegativeInt
    span_s: NonNegativeFloat
    nstep: NonNegativeInt
    steps_per_s: NonNegativeFloat | None
    real_time_factor: NonNegativeFloat | None
    step: Durations | None
    iteration: Durations | None
    of_environment: bool
    stages: Mapping[str, Share]
    cost_share: AnyFloat
    collections: NonNegativeInt
    collections_s: NonNegativeFloat
    longest_collection_s: NonNegativeFloat
    startup_s: NonNegativeFloat = 0.0

    @property
    def timestep_s(self) -> float | None:
        """Simulated seconds of a step, on average; None without one."""
        return (self.real_time_factor or 0.0) / self.steps_per_s if self.steps_per_s else None


def read_all(folder: Path) -> list[StepTimes]:
    """Return the steps of all processes whose files in a folder are whole, by process."""
    timers = read_engine(folder).timers
    times = []
    for file in sorted(folder.glob("*.steps")):
        with contextlib.suppress(InputError):
            times.append(read(file, timers))
    return times


def untimed_pids(folder: Path) -> set[int]:
    """Return the processes that had no space for their file: they left it empty."""
    return {int(file.stem) for file in folder.glob("*.steps") if not file.stat().st_size}


def read_headers(folder: Path) -> dict[int, Header]:
    headers = {}
    for file in folder.glob("*.steps"):
        with file.open("rb") as stream:
            head = stream.read(step_file.HEADER.size)
        if len(head) == step_file.HEADER.size:
            header = Header(*step_file.HEADER.unpack(head))
            headers[header.pid] = header
    return headers


def read(file: Path, timers: Mapping[str, int]) -> StepTimes:
    """Return the steps of one process; InputError for another file."""
    with file.open("rb") as stream:
        head = stream.read(step_file.FIRST_RECORD)
    if len(head) < step_file.FIRST_RECORD:
        raise InputError(f"{file.name} is not a file of the step clock")
    header = Header(*step_file.HEADER.unpack_from(head, 0))
    seconds = step_file.TIMERS.unpack_from(head, step_file.HEADER.size)
    stored = np.fromfile(file, _RECORDS, offset=step_file.FIRST_RECORD)
    used = int(np.searchsorted(stored["kind"] == 0, True))  # the rest of the file is zeros
    return step_times(header, stored[:used], seconds, timers)


def step_times(
    header: Header, records: np.ndarray, timer_s: Sequence[float], timers: Mapping[str, int]
) -> StepTimes:
    """Return what (count,) records of a process say, in the order in which they were written."""
    burst = np.cumsum(records["kind"] == step_file.BURST)
    is_step = records["kind"] == step_file.STEP
    steps = records[is_step]
    is_iteration = records["kind"] == step_file.ITERATION
    of_environment = bool(is_iteration.any())
    turns = is_iteration if of_environment else is_step & (records["nstep"] > 0)
    last_ns = max(header.last_ns, int(steps["end"].max(initial=0)))
    span_ns = max(0, last_ns - header.first_ns) if len(steps) else 0
    timed = int(steps["nstep"].sum())
    whole = 1.0  # calls per timed call
    if len(steps):
        whole = max(1.0, (header.calls_passed + len(steps)) / len(steps))
    simulated_ns = float((steps["nstep"] * steps["dt"]).sum())
    per_s = 1e9 * timed * whole / span_ns if span_ns else None
    return StepTimes(
        pid=header.pid,
        span_s=span_ns * 1e-9,
        nstep=round(timed * whole),
        steps_per_s=per_s,
        real_time_factor=per_s * simulated_ns * 1e-9 / timed if per_s and timed else None,
        step=Durations.of(_step_ns(steps)),
        iteration=Durations.of(_intervals_ns(header, records[turns], burst[turns])),
        of_environment=of_environment,
        stages=_stages(timer_s, timers, 1e-9 * float(np.sum(steps["end"] - steps["begin"]))),
        cost_share=min(1.0, header.cost_ns / span_ns) if span_ns else 0.0,
        collections=header.collections,
        collections_s=header.collections_ns * 1e-9,
        longest_collection_s=header.longest_collection_ns * 1e-9,
        startup_s=max(0, header.first_ns - header.process_ns) * 1e-9,
    )


def _step_ns(steps: np.ndarray) -> np.ndarray:
    """Return (count,) ns of a step of each call; a first part adds to the call that follows it."""
    duration_ns = (steps["end"] - steps["begin"]).astype(float)
    is_part = steps["nstep"] == 0
    following = np.flatnonzero(is_part[:-1] & ~is_part[1:])
    duration_ns[following + 1] += duration_ns[following]
    return np.asarray(duration_ns[~is_part] / steps["nstep"][~is_part])


def _intervals_ns(header: Header, records: np.ndarray, burst: np.ndarray) -> np.ndarray:
    """Return (count,) ns between the begins of records of one burst and one thread.

    What the clock costs for a record is subtracted. They are in the order of their begins.
    """
    begins, intervals = [], []
    for thread in np.unique(records["thread"]):
        of_thread = records["thread"] == thread
        begin, number = records["begin"][of_thread], burst[of_thread]
        is_within = np.diff(number) == 0
        begins.append(begin[:-1][is_within])
        intervals.append(np.diff(begin)[is_within] - header.timed_ns)
    if not intervals:
        return np.empty(0)
    in_order = np.argsort(np.concatenate(begins))
    return np.asarray(np.maximum(np.concatenate(intervals)[in_order], 0))


def _stages(timer_s: Sequence[float], timers: Mapping[str, int], step_s: float) -> dict[str, float]:
    seconds = {name: timer_s[i] for name, i in timers.items() if i < len(timer_s)}
    longest_s = max(seconds.values(), default=0.0)
    if not LEAST_TIMER_SHARE * step_s < longest_s < MOST_TIMER_SHARE * step_s:
        return {}
    return step_parts.stage_shares(seconds)


def read_engine(folder: Path) -> Engine:
    """Return the MuJoCo of a program; one without names where nothing of it could be written."""
    with contextlib.suppress(OSError, msgspec.MsgspecError):
        return msgspec.json.decode((folder / "engine.json").read_bytes(), type=Engine)
    return Engine()
