"""Two ways of doing something, as a program does it and as mjbench suggests, timed in turns.

Both run on the program's own model and states, in a child process: a model that crashes MuJoCo
costs only its ratio. The rows of tables declare the pairs.
"""

import itertools
import statistics
import time
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import mujoco

from mjbench.commands.run.recorded_models import RecordedModel, loadable
from mjbench.errors import MjbenchError
from mjbench.host import isolate
from mjbench.host.isolate import Channel
from mjbench.measuring import stats, timing
from mjbench.simulation import compat
from mjbench.simulation.engine_clock import engine_clock

# Seconds to time a pair; a child that is silent for longer than the limit is killed.
BUDGET_S, LIMIT_S = 0.5, 30.0
# Rounds: the interval of a median needs six at least. Seconds of a block, and calls of one at most.
LEAST_ROUNDS, MOST_ROUNDS, BLOCK_S, MOST_CALLS = 15, 200, 0.002, 1000
# Processes for a pair that uses threads: how fast threads wake differs from process to process, and
# they settle within a block. In eight processes, the pair of `rollout_each_step` in
# benchmarks.studies.own_programs gave ratios of 0.66 to 0.87 with blocks of 2 ms, and of 0.62 to
# 0.74 with 20 ms.
LAUNCHES_OF_THREADS, BLOCK_OF_THREADS_S = 5, 0.02
# What is raised where a release, a model or a machine lacks something; OpenGL raises its own kinds.
LACKING = (AttributeError, ImportError, ValueError, RuntimeError)


@dataclass(frozen=True)
class TimedWay:
    """One way of doing something.

    Attributes:
      create: creates an object for `use`, which together do what `run` does; None if it needs none.
      use: does the rest with the object, which the caller frees.
      has_timer: whether steps read the timer of MuJoCo's Python package.
      prepare: takes over a state, before it is timed.
    """

    run: Callable[[mujoco.MjData], object]
    create: Callable[[mujoco.MjData], Any] | None = None
    use: Callable[[Any, mujoco.MjData], None] = lambda *_: None
    has_timer: bool = True
    prepare: Callable[[mujoco.MjData], None] = lambda data: None

    @classmethod
    def creating(
        cls, create: Callable[[mujoco.MjData], Any], use: Callable[[Any, mujoco.MjData], None]
    ) -> "TimedWay":
        return cls(lambda data: use(create(data), data), create, use)


@dataclass(frozen=True)
class RemedyPair:
    """Two ways of doing something, and what they need to know of the program.

    Attributes:
      ways: returns what the program does, and what mjbench suggests; raises InputError, or one of
        `LACKING`, where it has no use. It is a function of a module, which pickles.
      functions: names of what is called, as `ways` takes them.
      simulations: in turn or at once; rays, where rays are cast.
      steps: of each simulation, of each call, after each new MjData, or before each call.
      frame, backend: of a renderer, height and width in pixels, and `MUJOCO_GL`.
      on_threads: whether other threads compute a part; then wall time counts.
      by_wall_time: whether its seconds are compared with wall time for another reason.
      of_copied: whether it needs states that the program copied.
    """

    ways: "Callable[[mujoco.MjModel, RemedyPair], tuple[TimedWay, TimedWay]]"
    functions: tuple[str, ...] | None = None
    simulations: int = 1
    steps: int = 1
    frame: tuple[int, int] = (240, 320)
    backend: str = ""
    on_threads: bool = False
    by_wall_time: bool = False
    of_copied: bool = False


@dataclass(frozen=True)
class TimeRatio:
    """The time of what mjbench suggests, over that of what the program does, with a 95 % interval.

    Attributes:
      low, high: of several processes, from the lowest end to the highest.
      saved_s: seconds that are saved each time, by the medians.
      created_share: share of the time of what the program does in which it creates an object:
        calls that are timed in the program hold that alone.
    """

    estimate: float
    low: float
    high: float
    saved_s: float
    created_share: float = 1.0

    @property
    def saved(self) -> float:
        """The share that is saved; 0 where that may be chance."""
        return 1 - self.estimate if self.high < 1 else 0.0

    @property
    def relative_error(self) -> float:
        return (self.high - self.low) / 4 / (1 - self.estimate) if self.saved else 0.0

    @property
    def certainly_saved_s(self) -> float:
        return self.saved_s if self.saved else 0.0


@dataclass(frozen=True)
class MeasuredRatios:
    """What was measured, and whether a step computes `cfrc_ext`, `cfrc_int` and `cacc`."""

    ratios: Mapping[RemedyPair, TimeRatio]
    computes_forces: bool | None = None


def measure(models: Sequence[RecordedModel], pairs: Sequence[RemedyPair]) -> MeasuredRatios:
    model = loadable(models)
    if model is None:
        return MeasuredRatios({})
    messages: list[MeasuredRatios] = []
    threaded = [pair for pair in pairs if pair.on_threads]
    others = [pair for pair in pairs if not pair.on_threads]
    # a library of OpenGL that does not work, or crashes, must not cost the other answers
    backends = dict.fromkeys(["", *(pair.backend for pair in others)])
    of_launches = [(b, [each for each in others if each.backend == b]) for b in backends]
    of_launches += [("", threaded)] * (LAUNCHES_OF_THREADS if threaded else 0)
    for backend, of_launch in of_launches:
        isolate.run(
            answer,
            (model, of_launch),
            messages.append,
            LIMIT_S,
            environment={"MUJOCO_GL": backend, "PYOPENGL_PLATFORM": None} if backend else None,
        )
    launches: dict[RemedyPair, list[TimeRatio]] = defaultdict(list)
    for message in messages:
        for pair, ratio in message.ratios.items():
            launches[pair].append(ratio)
    computes = [each.computes_forces for each in messages if each.computes_forces is not None]
    return MeasuredRatios(
        {pair: _of_launches(ratios) for pair, ratios in launches.items()},
        computes[-1] if computes else None,
    )


def _of_launches(ratios: Sequence[TimeRatio]) -> TimeRatio:
    """Return the median of several processes, with an interval that covers all of theirs."""
    median = sorted(ratios, key=lambda ratio: ratio.estimate)[len(ratios) // 2]
    low, high = min(ratio.low for ratio in ratios), max(ratio.high for ratio in ratios)
    return replace(median, low=low, high=high)


def answer(recorded: RecordedModel, pairs: Sequence[RemedyPair], channel: Channel) -> None:
    """Send what each pair comes to, one by one; runs in a child."""
    model = recorded.load()
    data = mujoco.MjData(model)
    for state in recorded.states[:1]:
        compat.set_state(model, data, state)
    mujoco.mj_step(model, data)
    channel.send(MeasuredRatios({}, bool(data.cacc.any())))
    for pair in pairs:
        try:
            ratio = _ratio(model, recorded, pair)
        except (MjbenchError, mujoco.FatalError, *LACKING):
            continue  # this release, this model, or this machine lacks something
        channel.send(MeasuredRatios({pair: ratio}))


def _ratio(model: mujoco.MjModel, recorded: RecordedModel, pair: RemedyPair) -> TimeRatio:
    present, suggested = pair.ways(model, pair)
    is_of_copies = pair.of_copied and len(recorded.copied) > 0
    states = recorded.copied if is_of_copies else recorded.states
    data = mujoco.MjData(model)

    def contender(way: TimedWay, calls: int) -> timing.Contender:
        turn = itertools.count()

        def before() -> None:
            engine_clock(way.has_timer)
            compat.set_state(model, data, states[next(turn) % len(states)])
            if not is_of_copies:
                mujoco.mj_step(model, data)
            way.prepare(data)

        def block() -> None:
            for _ in range(calls):
                way.run(data)

        return timing.Contender(block, before)

    # other processes on the same core lengthen the wall time alone
    is_by_wall_time = pair.on_threads or pair.by_wall_time
    clock = time.perf_counter if is_by_wall_time else time.thread_time
    one_s = min(timing.block_s(contender(present, 1), clock) for _ in range(3))
    block_s = BLOCK_OF_THREADS_S if pair.on_threads else BLOCK_S
    calls = max(1, min(MOST_CALLS, round(block_s / max(one_s, 1e-9))))
    contenders = [contender(present, calls), contender(suggested, calls)]
    rounds = list(timing.rounds(contenders, BUDGET_S, LEAST_ROUNDS, MOST_ROUNDS, clock=clock))
    faster = stats.speedup([first for first, _ in rounds], [second for _, second in rounds])
    assert faster.low is not None and faster.high is not None, "there are enough rounds"
    before_s, after_s = (
        statistics.median(seconds) / calls for seconds in zip(*rounds, strict=True)
    )
    shares = [_created_share(present, data, clock) for _ in range(LEAST_ROUNDS)]
    return TimeRatio(
        1 / faster.estimate,
        1 / faster.high,
        1 / faster.low,
        before_s - after_s,
        statistics.median(shares),
    )


def _created_share(way: TimedWay, data: mujoco.MjData, clock: timing.Clock) -> float:
    if way.create is None:
        return 1.0
    begin_s = clock()
    created = way.create(data)
    middle_s = clock()
    way.use(created, data)
    del created
    return (middle_s - begin_s) / max(1e-9, clock() - begin_s)
