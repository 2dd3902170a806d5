"""Vectorised forms of an environment, beside one environment: Gymnasium's Sync- and AsyncVectorEnv.

Environment i of a form is reset with seed + i and has actions of its own. A single environment for
each i does the same, one after the other, and resets in the same steps. What their steps return,
except info, must be equal to the last bit. All are new at first and run equally often, so that an
environment may remember earlier episodes, as statistics of its observations do.

They are measured in a child process. A form that ends it loses its own row; the child is started
again without it.
"""

import dataclasses
import functools
import random
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from mjbench.comparison.messages import AgreementReport
from mjbench.environment import adapters, construction
from mjbench.environment.adapters import EnvironmentAdapter, GymnasiumAdapter
from mjbench.environment.passes import PATIENCE, send_rounds
from mjbench.environment.records import EnvironmentRecord, VectorForm, VectorSamples
from mjbench.environment.repetition import Fingerprint
from mjbench.environment.run import EnvironmentPlan
from mjbench.environment.source import EnvironmentSource
from mjbench.errors import InputError, describe
from mjbench.host import isolate, machine
from mjbench.host.isolate import Channel
from mjbench.status import Status

# Steps of a block: as many as take one environment this long, within these bounds.
BLOCK_S, LEAST_NSTEP, MOST_NSTEP = 0.2, 20, 1000
# What a step returns, without info.
_FIELDS = ("observation", "reward", "terminated", "truncated")


@dataclass(frozen=True)
class VectorRequest:
    """What a child is to measure.

    Attributes:
      repeats: whether one environment did the same again.
      exclude: forms not to touch, by their index: they ended a child before.
    """

    source: EnvironmentSource
    plan: EnvironmentPlan
    step_s: float
    repeats: bool
    exclude: frozenset[int]


@dataclass(frozen=True)
class NoForms:
    """Why there are no vectorised forms of this environment, in one line."""

    reason: str


@dataclass(frozen=True)
class VectorRound:
    """One round: nanoseconds per step of one environment, by the index of the form."""

    ns: Mapping[int, float]
    single_ns: Mapping[int, float]


def added(
    record: EnvironmentRecord, source: EnvironmentSource, plan: EnvironmentPlan
) -> EnvironmentRecord:
    """Return a record with the vectorised forms of its environment, measured in child processes."""
    step_s = float(np.median(record.step_ns)) * 1e-9
    repeats = record.facts is not None and record.facts.repeats
    fatal: dict[int, AgreementReport] = {}
    while True:
        messages: list[object] = [*fatal.values()]
        request = VectorRequest(source, plan, step_s, repeats, frozenset(fatal))
        try:
            ended = isolate.run(
                "mjbench.environment.vectors:measure_in_child",
                request,
                messages.append,
                plan.limit_s,
            )
        except KeyboardInterrupt:
            return dataclasses.replace(
                record,
                status=Status.INTERRUPTED,
                detail="in vectorised forms",
                vectors=_samples(plan, messages, Status.INTERRUPTED, "stopped before it was timed"),
            )
        culprit = ended.item
        if ended.status == Status.OK or culprit is None or culprit in fatal:
            break
        fatal[culprit] = AgreementReport(culprit, ended.status, ended.detail)
    no_forms = next((each.reason for each in messages if isinstance(each, NoForms)), "")
    if no_forms or (ended.status == Status.INPUT and not messages):
        return dataclasses.replace(record, no_vectors=no_forms or ended.detail)
    samples = _samples(plan, messages, ended.status, ended.detail or "it was not timed")
    return dataclasses.replace(record, vectors=samples)


def _forms(plan: EnvironmentPlan) -> list[tuple[VectorForm, int]]:
    """Return the forms with their numbers of environments."""
    return [(form, nenv) for nenv in plan.nenv for form in VectorForm]


def _samples(
    plan: EnvironmentPlan, messages: Sequence[object], status: Status, detail: str
) -> list[VectorSamples]:
    """Return the samples of every form; one without a report, or without times, ended as given."""
    reports = {each.index: each for each in messages if isinstance(each, AgreementReport)}
    rounds = [each for each in messages if isinstance(each, VectorRound)]
    samples = []
    for index, (form, nenv) in enumerate(_forms(plan)):
        report = reports.get(index)
        timed = [each for each in rounds if index in each.ns]
        if report is not None and report.status != Status.OK:
            samples.append(VectorSamples(form, nenv, report.status, report.detail))
        elif report is None or not timed:
            samples.append(VectorSamples(form, nenv, status, detail))
        else:
            ns = [each.ns[index] for each in timed]
            single_ns = [each.single_ns[index] for each in timed]
            ncore = 1 if form == VectorForm.SYNC else min(nenv, machine.usable_cores())
            samples.append(VectorSamples(form, nenv, Status.OK, "", ns, single_ns, ncore))
    return samples


# -- in the child ---------------------------------------------------------------------------------


def measure_in_child(request: VectorRequest, channel: Channel) -> None:
    """Measure vectorised forms.

    Messages: `NoForms` where there are none; else an `AgreementReport` for each form, a
    `VectorRound` for each round, and another `AgreementReport` for each form that was wrong in a
    timed block.
    """
    channel.doing("making the environment for its vectorised forms")
    adapter = adapters.adapt(construction.make(request.source))
    reason = _no_forms(adapter)
    if reason:
        channel.send(NoForms(reason))
        return
    plan = request.plan
    most = max(plan.nenv)
    nstep = int(min(MOST_NSTEP, max(LEAST_NSTEP, BLOCK_S / most / max(request.step_s, 1e-9))))
    try:
        more = []
        for _ in range(most):
            channel.allow_silence(0.0)
            more.append(adapters.adapt(construction.make(request.source)))
    except InputError as error:
        channel.send(NoForms(f"it cannot be made twice in a process: {error}"))
        return
    twin = _Single(more.pop(), plan.seed, nstep)
    singles = [_Single(each, plan.seed + i, nstep) for i, each in enumerate([adapter, *more])]
    channel.doing("stepping the environment")
    channel.allow_silence(PATIENCE * request.step_s * nstep * most)
    for single in (twin, *singles):
        single.run()
        channel.allow_silence(0.0)
    if differences := twin.fingerprint().differences(singles[0].fingerprint()):
        named = f" ({', '.join(map(str, differences))})" if request.repeats else ""
        channel.send(NoForms(f"two of it, reset and stepped alike, return other values{named}"))
        return
    forms: dict[int, _Form] = {}
    for index, (kind, nenv) in enumerate(_forms(plan)):
        if index in request.exclude:
            continue
        channel.doing(f"making {kind} of {nenv}", index)
        channel.allow_silence(PATIENCE * request.step_s * nstep * nenv)
        report, form = _verified(index, kind, request.source, singles[:nenv])
        channel.send(report)
        if form is not None:
            forms[index] = form
    if forms:
        turns = _Turns(forms, singles, plan.seed, channel)
        send_rounds(turns.round, plan.budget_s, channel)
        for index, difference in turns.wrong.items():
            channel.send(AgreementReport(index, Status.DISAGREES, difference))
    for form in forms.values():
        form.close()


def _no_forms(adapter: EnvironmentAdapter) -> str:
    """Return why there are no vectorised forms of an environment; empty where there are."""
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
    """One environment that does what environment i of a vectorised form does.

    Attributes:
      returned: of the last run, what each step returned in the order of `_FIELDS`.
    """

    def __init__(self, adapter: EnvironmentAdapter, seed: int, nstep: int):
        """Draw random actions."""
        self._environment = adapter.environment
        self.seed = seed
        self.actions = adapter.draw_actions(nstep, seed)
        self.returned: list[Any] = []

    def run(self) -> float:
        """Take all steps, keep copies of what they return, and return their seconds."""
        environment, resets_next = self._environment, _resets_in_next_step()
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
                seconds += time.perf_counter() - begin
                self.returned.append(_copied(returned))
        return seconds

    def fingerprint(self) -> Fingerprint:
        """Return the fingerprint of what the last run returned."""
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
    """Return the results of a step that resets."""
    return returned[0], 0.0, False, False


@dataclass
class _Form:
    """A vectorised form of Gymnasium, to be timed.

    Attributes:
      batched: actions of all environments, for each step.
    """

    environments: Any
    singles: Sequence[_Single]
    batched: list[Any] = field(default_factory=list)
    returned: Sequence[Any] = ()

    def __post_init__(self) -> None:
        actions = zip(*(single.actions for single in self.singles), strict=True)
        self.batched = [np.stack(each) for each in actions]

    def reset(self) -> Any:
        """Reset all environments, each with its seed; return their observations."""
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
        """Return what the last step returned that a step of the singles did not, or empty."""
        differences = (
            single.difference(i, step, self.returned) for i, single in enumerate(self.singles)
        )
        return next(filter(None, differences), "")

    def run(self) -> float:
        """Take all steps, and return their seconds."""
        self.reset()
        step, returned = self.environments.step, ()
        begin = time.perf_counter()
        for actions in self.batched:
            returned = step(actions)
        seconds = time.perf_counter() - begin
        self.returned = returned[:-1]
        return seconds

    def close(self) -> None:
        """End its processes."""
        self.environments.close()


def _verified(
    index: int, kind: VectorForm, source: EnvironmentSource, singles: Sequence[_Single]
) -> tuple[AgreementReport, _Form | None]:
    """Make a form and compare its observations; return the report, and the form if it may be timed.

    Whatever it raises costs its own row.
    """
    import gymnasium

    try:
        vector_class = getattr(gymnasium.vector, kind.value)
        factory = functools.partial(construction.make, source)
        form = _Form(vector_class([factory] * len(singles)), singles)
        difference = form.difference()
    except Exception as error:
        return AgreementReport(index, Status.FAILED, describe(error)), None
    if difference:
        form.close()
        return AgreementReport(index, Status.DISAGREES, difference), None
    return AgreementReport(index, Status.OK), form


class _Turns:
    """Rounds in which vectorised forms and single environments take turns.

    Attributes:
      wrong: the first difference of each form that was wrong in a timed block, by its index.
    """

    def __init__(
        self, forms: Mapping[int, _Form], singles: Sequence[_Single], seed: int, channel: Channel
    ):
        self.wrong: dict[int, str] = {}
        self._forms, self._singles, self._channel = forms, singles, channel
        self._random = random.Random(seed)

    def round(self) -> VectorRound:
        """Time every form and every single environment once, in random order."""
        form_s: dict[int, float] = {}
        single_s = [0.0] * len(self._singles)
        turns = [(index, True) for index in self._forms]
        turns += [(i, False) for i in range(len(self._singles))]
        self._random.shuffle(turns)
        for index, is_form in turns:
            if is_form:
                self._channel.doing("timing a vectorised form", index)
                form_s[index] = self._forms[index].run()
            else:
                self._channel.doing("timing one environment")
                single_s[index] = self._singles[index].run()
        ns, single_ns = {}, {}
        for index, form in self._forms.items():
            if difference := form.difference_after(len(form.batched)):
                self.wrong.setdefault(index, f"in a timed block, {difference}")
            nenv = len(form.singles)
            count = nenv * len(form.batched)
            ns[index] = 1e9 * form_s[index] / count
            single_ns[index] = 1e9 * sum(single_s[:nenv]) / count
        return VectorRound(ns, single_ns)


def _resets_in_next_step() -> bool:
    """Return whether vectorised forms reset in the step after an episode's last (Gymnasium ≥ 1.0).

    Older ones reset in the last step itself.
    """
    import gymnasium

    return hasattr(gymnasium.vector, "AutoresetMode")


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
    """Return whether entry `i` of batched observations is that of one environment, bit by bit.

    A vectorised form converts observations to the types of the observation space.
    """
    if isinstance(single, dict):
        return all(_equal(value, batched[key], i) for key, value in single.items())
    if isinstance(single, tuple):
        return all(_equal(value, part, i) for value, part in zip(single, batched, strict=True))
    got = np.asarray(batched[i])
    expected = np.asarray(single).astype(got.dtype).reshape(got.shape)
    return bool(expected.tobytes() == got.tobytes())
