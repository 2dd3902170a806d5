"""Vectorised forms of an environment, beside one environment: Gymnasium's Sync- and AsyncVectorEnv.

Environment i of a form is reset with seed + i and has actions of its own. A single environment for
each i does the same, one after the other, and resets in the same steps. What their steps return,
except info, must be equal to the last bit. All are new at first and run equally often, so that an
environment may remember earlier episodes, as statistics of its observations do.

Each launch makes and compares them anew in a fresh process, and times them there. A form that is
wrong, or ends a process, loses its own row. A form has a position: that of its pair of form and
number of environments in `sized_forms`.
"""

import contextlib
import dataclasses
import functools
import math
import random
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from mjbench.commands.env import adapters, construction
from mjbench.commands.env.adapters import EnvironmentAdapter, GymnasiumAdapter
from mjbench.commands.env.child_process import EnvironmentPlan
from mjbench.commands.env.passes import PATIENCE
from mjbench.commands.env.repetition import Fingerprint
from mjbench.commands.env.result import EnvironmentRecord, VectorForm, VectorSamples
from mjbench.commands.env.source import EnvironmentSource
from mjbench.errors import Failure, InputError, describe
from mjbench.host import isolate, machine
from mjbench.host.isolate import Channel, Ended
from mjbench.measuring.timing import LEAST_S
from mjbench.paired.launches import StopRule, Targets, launch
from mjbench.status import Status

# Launches at least and at most; a 95 % interval needs six.
LEAST_LAUNCHES, MOST_LAUNCHES = 6, 50
# Rounds of a launch: every second one runs in the opposite order.
_ROUNDS = 2
# Steps of a block: as many as take one environment this long, within these bounds.
BLOCK_S, LEAST_NSTEP, MOST_NSTEP = 0.1, 20, 1000
# What a step returns, without info.
_FIELDS = ("observation", "reward", "terminated", "truncated")


@dataclass(frozen=True)
class VectorRequest:
    """What a child is to measure."""

    source: EnvironmentSource
    plan: EnvironmentPlan
    step_s: float
    repeats: bool
    positions: Sequence[int]


@dataclass(frozen=True)
class VectorLaunch:
    """One launch: nanoseconds per step of one environment, by the position of the form.

    Attributes:
      single_ns: of the same steps in one environment after the other.
      wrong: why the others cannot be timed.
    """

    ns: Mapping[int, float]
    single_ns: Mapping[int, float]
    wrong: Mapping[int, Failure] = field(default_factory=dict)


def sized_forms(plan: EnvironmentPlan) -> list[tuple[VectorForm, int]]:
    return [(form, nenv) for nenv in plan.nenv for form in VectorForm]


def added(
    record: EnvironmentRecord, source: EnvironmentSource, plan: EnvironmentPlan
) -> EnvironmentRecord:
    if plan.must_end and plan.budget_s <= 0:
        return dataclasses.replace(record, no_vectors="no time was left: give a longer --budget")
    step_s = float(np.median(record.step_ns)) * 1e-9
    repeats = record.facts is not None and record.facts.repeats
    rule = _VectorRule(plan)
    end_s = time.monotonic() + plan.budget_s if plan.must_end else math.inf
    targets = _VectorLaunches(VectorRequest(source, plan, step_s, repeats, ()), end_s)
    ending = launch(targets, rule)
    if ending.status == Status.INTERRUPTED:
        detail = "in vectorised forms"
        record = dataclasses.replace(record, status=ending.status, detail=detail)
        ending = Failure(ending.status, "stopped before it was timed")
    is_refused = ending.status == Status.INPUT or time.monotonic() >= end_s
    if is_refused and not rule.launches and not rule.wrong:
        return dataclasses.replace(record, no_vectors=ending.detail)
    return dataclasses.replace(record, vectors=rule.samples(ending))


@dataclass
class _VectorLaunches(Targets[VectorLaunch]):
    request: VectorRequest
    end_s: float

    def launch(self, positions: Sequence[int]) -> VectorLaunch:
        return isolate.call(
            measure_in_child,
            dataclasses.replace(self.request, positions=positions),
            limit_s=self.request.plan.limit_s,
            end_s=self.end_s,
            otherwise=_without_figures,
        )


def _without_figures(ended: Ended) -> VectorLaunch:
    """Return a launch that a form ended; raises as `Ended.check` does where none did."""
    if ended.position is None:
        ended.check()
    assert ended.position is not None, "it did not end well"
    return VectorLaunch({}, {}, {ended.position: Failure(ended.status, ended.detail)})


class _VectorRule(StopRule[VectorLaunch]):
    def __init__(self, plan: EnvironmentPlan, clock: Callable[[], float] = time.monotonic):
        self.launches: list[VectorLaunch] = []
        self.wrong: dict[int, Failure] = {}
        self._plan, self._clock, self._begin_s = plan, clock, clock()

    def next_targets(self) -> Sequence[int]:
        count, spent_s = len(self.launches), self._clock() - self._begin_s
        expected_s = spent_s * (count + 1) / max(1, count)
        is_over = expected_s > self._plan.budget_s or count == MOST_LAUNCHES
        if count >= (1 if self._plan.must_end else LEAST_LAUNCHES) and is_over:
            return ()
        return [i for i in range(len(sized_forms(self._plan))) if i not in self.wrong]

    def add(self, launch: VectorLaunch) -> None:
        """Take a launch into account; go on without forms that were wrong in it."""
        if launch.ns or not launch.wrong:
            self.launches.append(launch)
        self.wrong.update(launch.wrong)

    def samples(self, ending: Failure) -> list[VectorSamples]:
        """Return the samples of every form; one that was not timed ended as the launches did."""
        samples = []
        for position, (form, nenv) in enumerate(sized_forms(self._plan)):
            timed = [each for each in self.launches if position in each.ns]
            if (failure := self.wrong.get(position)) is not None:
                samples.append(VectorSamples(form, nenv, failure.status, failure.detail))
            elif not timed:
                detail = ending.detail or "it was not timed"
                samples.append(VectorSamples(form, nenv, ending.status, detail))
            else:
                ns = [each.ns[position] for each in timed]
                single_ns = [each.single_ns[position] for each in timed]
                ncore = 1 if form == VectorForm.SYNC else min(nenv, machine.usable_cores())
                samples.append(VectorSamples(form, nenv, Status.OK, "", ns, single_ns, ncore))
        return samples


# -- in the child ---------------------------------------------------------------------------------


def measure_in_child(request: VectorRequest, channel: Channel) -> VectorLaunch:
    """Make vectorised forms, compare and time them; InputError where there are none."""
    channel.doing("making the environment for its vectorised forms")
    adapter = adapters.adapt(construction.make(request.source))
    if reason := _no_forms(adapter):
        raise InputError(reason)
    all_forms = sized_forms(request.plan)
    most = max(all_forms[position][1] for position in request.positions)
    nstep = int(min(MOST_NSTEP, max(LEAST_NSTEP, BLOCK_S / most / max(request.step_s, 1e-9))))
    singles = _singles(request, adapter, nstep, most, channel)
    right: dict[int, _VectorEnvironment] = {}
    wrong: dict[int, Failure] = {}
    with contextlib.ExitStack() as closing:
        for position in request.positions:
            form, nenv = all_forms[position]
            channel.doing(f"making {form} of {nenv}", position)
            channel.allow_silence(PATIENCE * request.step_s * nstep * nenv)
            compared = _compared(form, request.source, singles[:nenv])
            if isinstance(compared, Failure):
                wrong[position] = compared
            else:
                closing.callback(compared.close)
                right[position] = compared
        channel.allow_silence(PATIENCE * request.step_s * nstep * most * len(right) * _ROUNDS)
        timed = _timed(right, singles, channel)
        return dataclasses.replace(timed, wrong={**wrong, **timed.wrong})


def _singles(
    request: VectorRequest, adapter: EnvironmentAdapter, nstep: int, count: int, channel: Channel
) -> list["_Single"]:
    """Return single environments that have run once; InputError if two of it differ."""
    seed, more = request.plan.seed, []
    try:
        for _ in range(count):
            channel.allow_silence(0.0)
            more.append(adapters.adapt(construction.make(request.source)))
    except InputError as error:
        raise InputError(f"it cannot be made twice in a process: {error}") from error
    twin = _Single(more.pop(), seed, nstep)
    singles = [_Single(each, seed + i, nstep) for i, each in enumerate([adapter, *more])]
    channel.doing("stepping the environment")
    channel.allow_silence(PATIENCE * request.step_s * nstep * count)
    for single in (twin, *singles):
        single.run()
        channel.allow_silence(0.0)
    if differences := twin.fingerprint().differences(singles[0].fingerprint()):
        named = f" ({', '.join(map(str, differences))})" if request.repeats else ""
        raise InputError(f"two of it, reset and stepped alike, return other values{named}")
    return singles


def _no_forms(adapter: EnvironmentAdapter) -> str:
    if not isinstance(adapter, GymnasiumAdapter):
        return "only Gymnasium has them"
    try:
        import gymnasium
    except ImportError:
        return "Gymnasium, which has them, is not installed here"
    if not isinstance(adapter.environment, gymnasium.Env):
        return "it is no gymnasium.Env"
    return ""


class _Single:
    """One environment that does what environment i of a vectorised form does."""

    def __init__(self, adapter: EnvironmentAdapter, seed: int, nstep: int):
        self._environment = adapter.environment
        self.seed = seed
        self.actions = adapter.draw_actions(nstep, seed)
        self.returned: list[Any] = []

    def run(self) -> float:
        """Take all steps, keep copies of what they return, and return their seconds."""
        import gymnasium

        environment = self._environment
        # a form resets in the step after an episode's last (Gymnasium ≥ 1.0)
        resets_next = hasattr(gymnasium.vector, "AutoresetMode")
        with construction.as_input_error("its step"):
            returned = _after_reset(environment.reset(seed=self.seed))
            self.returned = [_copied(returned)]
            seconds, is_over = 0.0, False
            for action in self.actions:
                begin = time.perf_counter()
                if is_over and resets_next:
                    returned = _after_reset(environment.reset())
                else:
                    returned = environment.step(action)[:-1]
                is_over = returned[2] or returned[3]
                if is_over and not resets_next:
                    returned = (environment.reset()[0], *returned[1:])
                seconds += max(LEAST_S, time.perf_counter() - begin)
                self.returned.append(_copied(returned))
        return seconds

    def fingerprint(self) -> Fingerprint:
        fingerprint = Fingerprint()
        for returned in self.returned:
            for name, value in zip(_FIELDS, returned, strict=True):
                fingerprint.add(name, value)
        return fingerprint

    def difference(self, i: int, step: int, batched: Sequence[Any]) -> str:
        """Return which field of a step's results is not that of environment i; empty without one.

        Args:
          step: 0 is the reset.
          batched: results of all environments, in the order of `_FIELDS`.
        """
        for name, single, batch in zip(_FIELDS, self.returned[step], batched, strict=False):
            if not _equal(single, batch, i):
                return f"environment {i} returns another {name} after step {step}"
        return ""


def _after_reset(returned: tuple[Any, Any]) -> tuple[Any, float, bool, bool]:
    return returned[0], 0.0, False, False


class _VectorEnvironment:
    def __init__(self, environments: Any, singles: Sequence[_Single]):
        self.environments, self.singles = environments, singles
        actions = zip(*(single.actions for single in singles), strict=True)
        self.batched = [np.stack(each) for each in actions]
        self.returned: Sequence[Any] = ()

    def reset(self) -> Any:
        return self.environments.reset(seed=[single.seed for single in self.singles])[0]

    def difference(self) -> str:
        """Run all steps; return what is not as in single environments, or empty."""
        self.returned = [self.reset()]
        for step in range(len(self.batched) + 1):
            if step:
                self.returned = self.environments.step(self.batched[step - 1])[:-1]
            if difference := self.difference_after(step):
                return difference
        return ""

    def difference_after(self, step: int) -> str:
        differences = (
            single.difference(i, step, self.returned) for i, single in enumerate(self.singles)
        )
        return next(filter(None, differences), "")

    def run(self) -> float:
        self.reset()
        step, returned = self.environments.step, ()
        begin = time.perf_counter()
        for actions in self.batched:
            returned = step(actions)
        seconds = max(LEAST_S, time.perf_counter() - begin)
        self.returned = returned[:-1]
        return seconds

    def close(self) -> None:
        self.environments.close()


def _compared(
    form: VectorForm, source: EnvironmentSource, singles: Sequence[_Single]
) -> _VectorEnvironment | Failure:
    """Make a form and compare what its steps return; whatever it raises costs its own row."""
    import gymnasium

    try:
        vector_class = getattr(gymnasium.vector, form.value)
        factory = functools.partial(construction.make, source)
        environment = _VectorEnvironment(vector_class([factory] * len(singles)), singles)
        difference = environment.difference()
    except Exception as error:
        return Failure(Status.FAILED, describe(error))
    if difference:
        environment.close()
        return Failure(Status.DISAGREES, difference)
    return environment


def _timed(
    environments: Mapping[int, _VectorEnvironment], singles: Sequence[_Single], channel: Channel
) -> VectorLaunch:
    right, wrong = dict(environments), dict[int, Failure]()
    form_s = dict.fromkeys(right, 0.0)
    single_s = [0.0] * len(singles)
    turns = [*((i, False) for i in range(len(singles))), *((i, True) for i in right)]
    random.Random().shuffle(turns)  # not the generator that the environment may have seeded
    for number in range(_ROUNDS):
        for i, is_form in turns[:: -1 if number % 2 else 1]:
            if not is_form:
                channel.doing("timing one environment")
                single_s[i] += singles[i].run()
            elif i in right:
                channel.doing("timing a vectorised form", i)
                form_s[i] += right[i].run()
        for position, environment in list(right.items()):
            if difference := environment.difference_after(len(environment.batched)):
                del right[position]
                wrong[position] = Failure(Status.DISAGREES, f"in a timed block, {difference}")
    ns, single_ns = {}, {}
    for position, environment in right.items():
        nenv = len(environment.singles)
        count = _ROUNDS * nenv * len(environment.batched)
        ns[position] = 1e9 * form_s[position] / count
        single_ns[position] = 1e9 * sum(single_s[:nenv]) / count
    return VectorLaunch(ns, single_ns, wrong)


def _copied(observation: Any) -> Any:
    """Return a copy of what an environment returned, as it may use the memory again."""
    match observation:
        case Mapping():
            return {key: _copied(value) for key, value in observation.items()}
        case tuple() | list():
            return tuple(_copied(value) for value in observation)
        case np.ndarray() | np.generic() | float() | int():
            return np.array(observation)
    raise InputError(f"it returns {type(observation).__name__}, which cannot be compared")


def _equal(single: Any, batched: Any, i: int) -> bool:
    """Return whether batched observation i is that of one environment, converted, bit by bit."""
    if isinstance(single, dict):
        return all(_equal(value, batched[key], i) for key, value in single.items())
    if isinstance(single, tuple):
        return all(_equal(value, part, i) for value, part in zip(single, batched, strict=True))
    got = np.asarray(batched[i])
    expected = np.asarray(single).astype(got.dtype).reshape(got.shape)
    return bool(expected.tobytes() == got.tobytes())
