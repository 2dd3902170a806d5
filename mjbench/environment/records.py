"""What is stored of an environment: every sample, and what was recorded before timing.

Frozen dataclasses, which also travel from the child processes to the parent.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any, ClassVar

from mjbench.environment.dm_control_release import ReleaseMismatch
from mjbench.environment.layers import Layer
from mjbench.environment.model_changes import ModelChange
from mjbench.environment.repetition import FieldDifference
from mjbench.environment.timer import TimerCost
from mjbench.errors import Failure
from mjbench.instrument.bounds import (
    AnyFloat,
    Nanoseconds,
    NonNegativeFloat,
    NonNegativeInt,
    PositiveFloat,
    PositiveInt,
)
from mjbench.simulation.work import ModelFacts
from mjbench.status import Status


@dataclass(frozen=True)
class EnvironmentFacts:
    """An environment, and what was recorded of it.

    Attributes:
      framework: whose it is, such as `Gymnasium`.
      core: class of the innermost environment.
      wrappers: classes of the environments around it, the outermost first.
      versions: of the packages that these classes come from, by name.
      seed: of the actions and of the first reset.
      nepisode: episodes that were begun.
      episode_nstep: steps of an episode, the mean of those that ended; None where none did.
      repeats: whether it did the same in another pass with the same seeds and actions.
      frame_skip: steps of the engine in a step of the environment; None where they vary.
      calls: functions by which it steps the engine, such as `mj_step ×5`, in their order.
      entered: fields of the state, other than ctrl, that it writes before a step of the engine.
      model: facts about its model.
      unrepeated: what was not the same in another pass; empty where all was, and in older files.
      dm_control_release: how that which dm_control was built for differs from the installed one;
        None where it does not, or dm_control was not used.
    """

    framework: str
    core: str
    wrappers: Sequence[str]
    versions: Mapping[str, str]
    seed: NonNegativeInt
    nstep: PositiveInt
    nepisode: PositiveInt
    episode_nstep: PositiveFloat | None
    repeats: bool
    frame_skip: PositiveInt | None
    calls: Sequence[str]
    entered: Sequence[str]
    model: ModelFacts | None
    unrepeated: Sequence[FieldDifference] = ()
    dm_control_release: ReleaseMismatch | None = None


@dataclass(frozen=True)
class PhysicsCheck:
    """Whether a plain loop does what the engine did inside the environment.

    Attributes:
      status: `ok`; `disagrees` where a plain `mj_step` did not reach the same state; `unavailable`
        where the environment does what no plain loop does.
      detail: why it is not ok, in one line.
      checked: calls of the engine that a plain `mj_step` repeated, each from the same state.
      covered: steps of the environment that the comparison covers.
      run: of these, consecutive ones in each simulation; None without a comparison.
      holds: whether a control is held for all steps of the engine in a step of the environment;
        None without a comparison.
    """

    status: Status
    detail: str
    checked: NonNegativeInt
    covered: NonNegativeInt = 0
    run: PositiveInt | None = None
    holds: bool | None = None


@dataclass(frozen=True)
class LayerSamples:
    """What a function inside the step took in each round.

    Attributes:
      name: of the function, or of the wrapper's or environment's class.
      calls: of it, per step of the environment.
      timed_calls: of these, how many were timed.
      inner_calls: timed calls of other functions, per step.
      ns: per step, without functions that it calls and that are timed, with the timer's cost.
    """

    layer: Layer
    name: str
    calls: NonNegativeFloat
    timed_calls: NonNegativeFloat
    inner_calls: NonNegativeFloat
    ns: Sequence[NonNegativeFloat]


@dataclass(frozen=True)
class PathSamples:
    """How long the same physics took by one path, in each round.

    Attributes:
      closed_loop: whether a policy can choose each control.
      status: `ok`, or why it has no speed.
      ns: per step of the environment.
    """

    path: str
    options: Mapping[str, Any]
    closed_loop: bool
    status: Status
    detail: str
    ns: Sequence[Nanoseconds] = ()


class VectorForm(StrEnum):
    """A vectorised form of Gymnasium."""

    SYNC = "SyncVectorEnv"
    ASYNC = "AsyncVectorEnv"


@dataclass(frozen=True)
class VectorSamples:
    """How long steps of several environments took together, in each round.

    Attributes:
      status: `ok`, or why it has no speed.
      ns: per step of one environment.
      single_ns: of the same steps in one environment after the other, resets included as well.
      ncore: cores that it can use: 1, or one for each process as far as there are; None where it
        was not timed, and in older files.
    """

    form: VectorForm
    nenv: PositiveInt
    status: Status
    detail: str = ""
    ns: Sequence[Nanoseconds] = ()
    single_ns: Sequence[Nanoseconds] = ()
    ncore: PositiveInt | None = None

    def __post_init__(self) -> None:
        """Check that each round has both times.

        Raises:
          ValueError: it has not.
        """
        if len(self.ns) != len(self.single_ns):
            raise ValueError("ns and single_ns differ in length")


@dataclass(frozen=True, kw_only=True)
class EnvironmentRecord:
    """What was measured of an environment; nanoseconds are per step of it, one entry per round.

    Attributes:
      environment: its name, as the user typed it.
      status: `ok`, or why it was not measured to the end.
      facts: None where it could not be stepped.
      check: of its physics; None likewise.
      step_ns: of plain passes.
      compared_ns: of plain passes, over the steps that the comparison covers alone.
      reset_ns: of a reset, in plain passes.
      layered_ns: of passes in which functions were timed, with the timer's cost.
      timer_ns: by which a step took longer because functions were timed, the median of all steps.
      timer_cost: what a call of a timed function costs at least.
      layers: what each function took.
      paths: the same physics by other paths.
      cores: that threads got, in each round (see `machine.Calibration`).
      no_vectors: why there are none; empty where there are.
    """

    record_type: ClassVar[str] = "environment"
    environment: str
    status: Status = Status.OK
    detail: str = ""
    facts: EnvironmentFacts | None = None
    check: PhysicsCheck | None = None
    changes: Sequence[ModelChange] = field(default=())
    step_ns: Sequence[Nanoseconds] = field(default=())
    compared_ns: Sequence[Nanoseconds] = field(default=())
    reset_ns: Sequence[NonNegativeFloat] = field(default=())
    layered_ns: Sequence[Nanoseconds] = field(default=())
    timer_ns: Sequence[AnyFloat] = field(default=())
    timer_cost: TimerCost | None = None
    layers: Sequence[LayerSamples] = field(default=())
    paths: Sequence[PathSamples] = field(default=())
    cores: Sequence[PositiveFloat] = field(default=())
    vectors: Sequence[VectorSamples] = field(default=())
    no_vectors: str = ""

    def __post_init__(self) -> None:
        """Check that what was timed is described, and that every round has all its times.

        Raises:
          ValueError: it is not.
        """
        rounds = len(self.step_ns)
        if rounds and (self.facts is None or self.timer_cost is None or not self.layers):
            raise ValueError(
                "it was timed, but its facts, its timer's cost or its layers are missing"
            )
        each_round = [self.reset_ns, self.layered_ns, self.timer_ns, *(s.ns for s in self.layers)]
        if any(len(samples) != rounds for samples in each_round):
            raise ValueError("step_ns and the other times of rounds differ in length")
        if any(path.ns for path in self.paths) and not self.compared_ns:
            raise ValueError("paths were timed, but compared_ns is missing")

    @classmethod
    def failed(cls, environment: str, failure: Failure) -> "EnvironmentRecord":
        """Return the record of an environment that could not be measured."""
        return cls(environment=environment, status=failure.status, detail=failure.detail)
