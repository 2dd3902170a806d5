"""What a call takes that could stand in place of another, on the program's own model and states.

Both are timed in turns, in a child process: a model that crashes MuJoCo costs only its ratio.
"""

import copy
import enum
import itertools
import statistics
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from mjbench.errors import InputError, MjbenchError
from mjbench.host import isolate, machine
from mjbench.host.isolate import Channel
from mjbench.measuring import stats, timing
from mjbench.program.recorded_models import RecordedModel, loadable
from mjbench.simulation import compat
from mjbench.simulation.engine_clock import engine_clock

# Seconds to time a pair; a child that is silent for longer than the limit is killed.
BUDGET_S, LIMIT_S = 0.5, 30.0
# Rounds: the interval of a median needs six at least. Seconds of a block, and calls of one at most.
LEAST_ROUNDS, MOST_ROUNDS, BLOCK_S, MOST_CALLS = 15, 200, 0.002, 1000


class Trial(enum.StrEnum):
    """Two ways of doing something; the second is what mjbench suggests."""

    FUNCTIONS = "other functions of the engine"
    """`mj_step` with `mj_forward`, and with the functions that are enough."""
    NEW_DATA_OR_RESET = "mj_resetData"
    """`MjData(model)` with steps, which new memory costs, too, and `mj_resetData` with steps."""
    NEW_DATA_OR_COPY = "mj_copyData"
    """Likewise, with the state of another MjData."""
    COPY_OR_COPY = "mj_copyData in place of copy"
    """`copy.copy(data)` with steps, and `mj_copyData` with steps."""
    DEEP_COPY_OR_COPY = "mj_copyData in place of deepcopy"
    """Likewise, with `copy.deepcopy(data)`, which copies the model, too."""
    ONE_CALL = "nstep"
    """Ten calls of `mj_step`, and one with `nstep=10`."""
    NO_TIMER = "no timer"
    """`mj_step` with the timer of MuJoCo's Python package, and without."""
    NAMED_ACCESS = "hoisted accessor"
    """An element looked up by its name, and an attribute of one that was looked up before."""
    POOL = "pool of threads"
    """`mujoco.rollout.rollout`, and `Rollout`, which keeps its threads."""
    BATCH = "Batch"
    """`mj_step` of several simulations in turn, and `mujoco.batch.Batch`."""
    RENDERER = "one Renderer"
    """A frame by a `Renderer` of its own, and by one that stays."""


@dataclass(frozen=True)
class Question:
    """What to measure.

    Attributes:
      steps: of each simulation, for `Trial.POOL`; after each new MjData; of each call, for
        `Trial.NO_TIMER`.
      frame: height and width in pixels, for `Trial.RENDERER`.
      backend: `MUJOCO_GL` of the program, for `Trial.RENDERER`.
    """

    trial: Trial
    functions: tuple[str, ...] = ()
    simulations: int = 1
    steps: int = 1
    frame: tuple[int, int] = (240, 320)
    backend: str = ""


@dataclass(frozen=True)
class TimeRatio:
    """The time of what mjbench suggests, over that of what the program does.

    Attributes:
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


@dataclass(frozen=True)
class Measured:
    """What was measured on the program's own model.

    Attributes:
      computes_forces: whether a step of the model computes `cfrc_ext`, `cfrc_int` and `cacc`; None
        where that is not known.
    """

    ratios: Mapping[Question, TimeRatio]
    computes_forces: bool | None = None

    def saved(self, question: Question) -> float | None:
        """Return the share of the time of what the program does that is saved; None if unknown.

        It is 0 where nothing is certainly saved.
        """
        ratio = self.ratios.get(question)
        return None if ratio is None else ratio.saved

    def saved_s(self, question: Question) -> float | None:
        """Return the seconds that are saved each time; None if unknown."""
        ratio = self.ratios.get(question)
        return None if ratio is None else ratio.saved_s if ratio.saved else 0.0


@dataclass(frozen=True)
class _Request:
    """To the child: on which models to measure what."""

    model: RecordedModel
    questions: Sequence[Question]


@dataclass(frozen=True)
class _Answer:
    """From the child: the ratio of a question."""

    number: int
    ratio: TimeRatio


@dataclass(frozen=True)
class _Forces:
    """From the child: whether a step computes them."""

    computes_forces: bool


def measure(models: Sequence[RecordedModel], questions: Sequence[Question]) -> Measured:
    """Return the ratio of each question that could be measured.

    Args:
      models: of the program; the first that this process's MuJoCo can load is used.
    """
    model = loadable(models)
    if model is None:
        return Measured({})
    ratios: dict[Question, TimeRatio] = {}
    forces: list[bool] = []
    # a library of OpenGL that does not work, or crashes, must not cost the other answers
    for backend in dict.fromkeys(["", *(question.backend for question in questions)]):
        asked = [question for question in questions if question.backend == backend]
        messages: list[_Answer | _Forces] = []
        isolate.run(
            "mjbench.program.replacements:answer",
            _Request(model, asked),
            messages.append,
            LIMIT_S,
            environment={"MUJOCO_GL": backend, "PYOPENGL_PLATFORM": None} if backend else None,
        )
        for message in messages:
            if isinstance(message, _Answer):
                ratios[asked[message.number]] = message.ratio
            else:
                forces.append(message.computes_forces)
    return Measured(ratios, forces[0] if forces else None)


def answer(request: _Request, channel: Channel) -> None:
    """Measure all questions; runs in a child."""
    model = request.model.load()
    data = mujoco.MjData(model)
    for state in request.model.states[:1]:
        compat.set_state(model, data, state)
    mujoco.mj_step(model, data)
    channel.send(_Forces(bool(data.cacc.any())))
    for number, question in enumerate(request.questions):
        try:
            ratio = _ratio(model, request.model, question)
        except (MjbenchError, mujoco.FatalError, *_LACKING):
            continue  # this release, this model, or this machine lacks something
        channel.send(_Answer(number, ratio))


@dataclass(frozen=True)
class _Way:
    """One way of doing something.

    Attributes:
      create: creates an object for `use`, which together do what `run` does; None if it needs none.
      use: does the rest with the object, which the caller frees.
      has_timer: whether steps read the timer of MuJoCo's Python package.
    """

    run: Callable[[mujoco.MjData], object]
    create: Callable[[mujoco.MjData], Any] | None = None
    use: Callable[[Any, mujoco.MjData], None] = lambda *_: None
    has_timer: bool = True


def _ratio(model: mujoco.MjModel, recorded: RecordedModel, question: Question) -> TimeRatio:
    """Return the ratio of the times, over all states in turn."""
    present, suggested = _ways(model, question)
    is_of_copies = question.trial in _COPIERS and len(recorded.copied) > 0
    states = recorded.copied if is_of_copies else recorded.states
    data = mujoco.MjData(model)

    def contender(way: _Way, calls: int) -> timing.Contender:
        turn = itertools.count()

        def before() -> None:
            engine_clock(way.has_timer)
            compat.set_state(model, data, states[next(turn) % len(states)])
            if not is_of_copies:
                mujoco.mj_step(model, data)

        def block() -> None:
            for _ in range(calls):
                way.run(data)

        return timing.Contender(block, before)

    # other processes on the same core lengthen the wall time alone
    clock = time.perf_counter if question.trial in _BY_WALL_TIME else time.thread_time
    one_s = min(timing.block_s(contender(present, 1), clock) for _ in range(3))
    calls = max(1, min(MOST_CALLS, round(BLOCK_S / max(one_s, 1e-9))))
    contenders = [contender(present, calls), contender(suggested, calls)]
    rounds = list(timing.rounds(contenders, BUDGET_S, LEAST_ROUNDS, MOST_ROUNDS, clock=clock))
    faster = stats.speedup([first for first, _ in rounds], [second for _, second in rounds])
    assert faster.low is not None and faster.high is not None, "there are enough rounds"
    before_s, after_s = (
        statistics.median(seconds) / calls for seconds in zip(*rounds, strict=True)
    )
    shares = [_created_share(present, data, clock) for _ in range(LEAST_ROUNDS)]
    return TimeRatio(
        1 / faster.median,
        1 / faster.high,
        1 / faster.low,
        before_s - after_s,
        statistics.median(shares),
    )


def _created_share(way: _Way, data: mujoco.MjData, clock: timing.Clock) -> float:
    """Return the share of the time of a way in which it creates its object."""
    if way.create is None:
        return 1.0
    begin_s = clock()
    created = way.create(data)
    middle_s = clock()
    way.use(created, data)
    del created
    return (middle_s - begin_s) / max(1e-9, clock() - begin_s)


def _creating(
    create: Callable[[mujoco.MjData], Any], use: Callable[[Any, mujoco.MjData], None]
) -> _Way:
    """Return a way that creates an object each time."""
    return _Way(lambda data: use(create(data), data), create, use)


def _named_access(model: mujoco.MjModel, question: Question) -> tuple[_Way, _Way]:
    """Return the access to an element by its name, and that to one looked up before."""
    body = model.body(model.nbody - 1).name
    hoisted: dict[int, Any] = {}

    def before_the_loop(data: mujoco.MjData) -> Any:
        if id(data) not in hoisted:
            hoisted[id(data)] = data.body(body)
        return hoisted[id(data)].xpos

    if not body:
        raise InputError("the model has no name to look up")
    return _Way(lambda data: data.body(body).xpos), _Way(before_the_loop)


def _pool(model: mujoco.MjModel, question: Question) -> tuple[_Way, _Way]:
    """Return rollout with threads of its own, and with a pool that stays."""
    from mujoco import rollout

    threads = machine.usable_cores()
    datas = [mujoco.MjData(model) for _ in range(threads)]
    spec = compat.FULLPHYSICS
    start = np.empty((1, mujoco.mj_stateSize(model, spec)))
    mujoco.mj_getState(model, datas[0], start[0], spec)
    starts = np.repeat(start, question.simulations, axis=0)
    pool = rollout.Rollout(nthread=threads)
    return (
        _Way(lambda data: rollout.rollout(model, datas, starts, nstep=question.steps)),
        _Way(lambda data: pool.rollout(model, datas, starts, nstep=question.steps)),
    )


def _batch(model: mujoco.MjModel, question: Question) -> tuple[_Way, _Way]:
    """Return simulations in turn, and as a batch, from the model's own start."""
    from mujoco.batch import Batch

    datas = [mujoco.MjData(model) for _ in range(question.simulations)]
    batch = Batch(model, question.simulations)

    def in_turn(data: mujoco.MjData) -> None:
        for each in datas:
            mujoco.mj_step(model, each)

    return _Way(in_turn), _Way(lambda data: batch.step())


def _new_data(model: mujoco.MjModel, question: Question) -> tuple[_Way, _Way]:
    """Return steps of a new MjData, and of one that stays."""
    scratch = mujoco.MjData(model)
    is_copy = question.trial != Trial.NEW_DATA_OR_RESET

    def create(data: mujoco.MjData) -> mujoco.MjData:
        copier = _COPIERS.get(question.trial)
        return mujoco.MjData(model) if copier is None else copier(data)

    def use(fresh: mujoco.MjData, data: mujoco.MjData) -> None:
        if question.trial == Trial.NEW_DATA_OR_COPY:
            compat.copied_data(model, fresh, data)
        step(fresh)

    def step(stepped: mujoco.MjData) -> None:
        for _ in range(question.steps):
            mujoco.mj_step(model, stepped)

    def again(data: mujoco.MjData) -> None:
        if is_copy:
            compat.copied_data(model, scratch, data)
        else:
            mujoco.mj_resetData(model, scratch)
        step(scratch)

    return _creating(create, use), _Way(again)


def _renderer(model: mujoco.MjModel, question: Question) -> tuple[_Way, _Way]:
    """Return a frame by a renderer of its own, and by one that stays."""
    height, width = question.frame
    model.vis.global_.offheight = max(height, model.vis.global_.offheight)
    model.vis.global_.offwidth = max(width, model.vis.global_.offwidth)
    permanent = mujoco.Renderer(model, height, width)

    def draw(renderer: mujoco.Renderer, data: mujoco.MjData) -> None:
        renderer.update_scene(data)
        renderer.render()

    def create(data: mujoco.MjData) -> mujoco.Renderer:
        return mujoco.Renderer(model, height, width)

    return _creating(create, draw), _Way(lambda data: draw(permanent, data))


_COPIERS: Mapping[Trial, Callable[[mujoco.MjData], mujoco.MjData]] = {
    Trial.COPY_OR_COPY: copy.copy,
    Trial.DEEP_COPY_OR_COPY: copy.deepcopy,
}
# Trials of which other threads compute a part, or whose seconds are compared with wall time.
_BY_WALL_TIME = {Trial.POOL, Trial.BATCH, Trial.RENDERER, Trial.NAMED_ACCESS}
# What is raised where a release, a model or a machine lacks something; OpenGL raises its own kinds.
_LACKING = (AttributeError, ImportError, ValueError, RuntimeError)
_BUILDERS: Mapping[Trial, Callable[[mujoco.MjModel, Question], tuple[_Way, _Way]]] = {
    Trial.NAMED_ACCESS: _named_access,
    Trial.NEW_DATA_OR_RESET: _new_data,
    Trial.NEW_DATA_OR_COPY: _new_data,
    Trial.COPY_OR_COPY: _new_data,
    Trial.DEEP_COPY_OR_COPY: _new_data,
    Trial.RENDERER: _renderer,
    Trial.POOL: _pool,
    Trial.BATCH: _batch,
}


def _ways(model: mujoco.MjModel, question: Question) -> tuple[_Way, _Way]:
    """Return what the program does, and what mjbench suggests."""
    if question.trial in _BUILDERS:
        return _BUILDERS[question.trial](model, question)

    def then(names: Sequence[str]) -> Callable[[mujoco.MjData], None]:
        functions = [getattr(mujoco, name) for name in ("mj_step", *names)]

        def run(data: mujoco.MjData) -> None:
            for function in functions:
                function(model, data)

        return run

    def ten_steps(data: mujoco.MjData) -> None:
        for _ in range(10):
            mujoco.mj_step(model, data)

    def as_now(data: mujoco.MjData) -> None:
        for _ in range(10):
            mujoco.mj_step(model, data, question.steps)

    def one_call(data: mujoco.MjData) -> None:
        mujoco.mj_step(model, data, 10)

    ways: dict[Trial, tuple[_Way, _Way]] = {
        Trial.FUNCTIONS: (_Way(then(["mj_forward"])), _Way(then(question.functions))),
        Trial.ONE_CALL: (_Way(ten_steps), _Way(one_call)),
        Trial.NO_TIMER: (_Way(as_now), _Way(as_now, has_timer=False)),
    }
    return ways[question.trial]
