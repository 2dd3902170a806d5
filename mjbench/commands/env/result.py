"""An environment: every sample, what was recorded before timing, and the figures that follow.

Frozen dataclasses, which also travel from the child processes to the parent.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from mjbench import paths
from mjbench.bounds import (
    AnyFloat,
    Int64,
    Nanoseconds,
    NonNegativeFloat,
    NonNegativeInt,
    PositiveFloat,
    PositiveInt,
)
from mjbench.commands.env.construction import ReleaseMismatch
from mjbench.commands.env.layer_shares import LayerShare, LayerTimes, TimerEffect
from mjbench.commands.env.layers import Layer
from mjbench.commands.env.recording import ModelChange
from mjbench.commands.env.repetition import FieldDifference
from mjbench.commands.env.timer import LayerSamples, TimerCost
from mjbench.errors import Failure
from mjbench.interval import Interval
from mjbench.measuring import stats
from mjbench.results.json_form import in_json
from mjbench.simulation.reference_run import ModelFacts
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
      unrepeated: what was not the same in another pass; empty where all was.
      left_by_reset: fields of MjData that its reset leaves as they were.
      dm_control_release: how that which dm_control was built for differs from the installed one;
        None where it does not, or dm_control was not used.
    """

    framework: str
    core: str
    wrappers: Sequence[str]
    versions: Mapping[str, str]
    seed: Int64
    nstep: PositiveInt
    nepisode: PositiveInt
    episode_nstep: PositiveFloat | None
    repeats: bool
    frame_skip: PositiveInt | None
    calls: Sequence[str]
    entered: Sequence[str]
    model: ModelFacts | None
    unrepeated: Sequence[FieldDifference] = ()
    left_by_reset: Sequence[str] = ()
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

    @property
    def env_steps_per_s(self) -> float | None:
        return 1e9 / float(np.median(self.ns)) if self.ns else None


@in_json(
    *("path", "options", "closed_loop", "status", "detail"),
    *("env_steps_per_s", "steps_per_s", "speedup", "over_loop"),
)
@dataclass(frozen=True, kw_only=True)
class PhysicsPath(PathSamples):
    """The same physics by a path, beside the environment; None is what was not measured.

    Attributes:
      steps_per_s: of the engine.
      speedup: over steps of the environment, round by round.
      over_loop: speed-up over the plain loop, round by round.
    """

    steps_per_s: float | None
    speedup: Interval | None
    over_loop: Interval | None


class VectorForm(StrEnum):
    """A vectorised form of Gymnasium."""

    SYNC = "SyncVectorEnv"
    ASYNC = "AsyncVectorEnv"


@in_json(
    *("form", "nenv", "status", "detail", "env_steps_per_s", "speedup", "step_ns", "overhead_ns"),
    "ncore",
)
@dataclass(frozen=True)
class VectorSamples:
    """How long steps of several environments took together, in each launch.

    Attributes:
      status: `ok`, or why it has no speed.
      ns: per step of one environment.
      single_ns: of the same steps in one environment after the other, resets included as well.
      ncore: cores that it can use: 1, or one for each process as far as there are; None where it
        was not timed.
    """

    form: VectorForm
    nenv: PositiveInt
    status: Status
    detail: str = ""
    ns: Sequence[Nanoseconds] = ()
    single_ns: Sequence[Nanoseconds] = ()
    ncore: PositiveInt | None = None

    def __post_init__(self) -> None:
        if len(self.ns) != len(self.single_ns):
            raise ValueError("ns and single_ns differ in length")

    @property
    def env_steps_per_s(self) -> float | None:
        """Steps of all its environments together, resets included; None without a speed."""
        return 1e9 / float(np.median(self.ns)) if self.ns else None

    @cached_property
    def speedup(self) -> Interval | None:
        """Speed-up over one environment, resets included, by launches; None without a speed."""
        return stats.speedup_in_common(self.single_ns, self.ns) if self.ns else None

    @property
    def step_ns(self) -> float | None:
        """What the step takes on the cores that the form can use, if each is as fast as one alone.

        None where these are unknown.
        """
        return float(np.median(self.single_ns)) / self.ncore if self.ns and self.ncore else None

    @property
    def overhead_ns(self) -> float | None:
        """The rest of a step, which the form adds: it passes actions and results on."""
        return None if self.step_ns is None else float(np.median(self.ns)) - self.step_ns


@dataclass(frozen=True)
class ResetTime:
    """What a reset takes.

    Attributes:
      step_ns: per step of the environment, at the length that episodes had; None where none ended.
      episode_share: of the time of an episode of that length; where none ended, of all steps that
        were recorded, so that its share of an episode is less.
    """

    ns: Interval
    step_ns: float | None
    episode_share: float


@in_json(
    *("environment", "status", "detail", "facts", "check", "changes", "rounds"),
    *("step_ns", "env_steps_per_s", "steps_per_s", "layers", "timer", "reset"),
    *("paths", "cores", "vectors", "no_vectors"),
    step_ns="step",
    layers="layer_shares",
    paths="physics_paths",
    cores="median_cores",
)
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
        rounds = len(self.step_ns)
        if rounds and (self.facts is None or self.timer_cost is None or not self.layers):
            raise ValueError(
                "it was timed, but its facts, its timer's cost or its layers are missing"
            )
        each_round = [self.reset_ns, self.layered_ns, self.timer_ns, *(s.ns for s in self.layers)]
        if any(len(samples) != rounds for samples in each_round):
            raise ValueError("step_ns and the other times of rounds differ in length")
        if not rounds and (self.cores or self.vectors or self.no_vectors):
            raise ValueError("it was not timed, but has cores or vectorised forms")
        if any(path.ns for path in self.paths) and not self.compared_ns:
            raise ValueError("paths were timed, but compared_ns is missing")

    @classmethod
    def failed(cls, environment: str, failure: Failure) -> "EnvironmentRecord":
        return cls(environment=environment, status=failure.status, detail=failure.detail)

    @property
    def is_timed(self) -> bool:
        """Whether there are figures; without times, a step, layers, paths and forms have none."""
        return self.facts is not None and bool(self.step_ns)

    @property
    def rounds(self) -> int:
        return len(self.step_ns) if self.is_timed else 0

    @cached_property
    def step(self) -> Interval | None:
        """Nanoseconds of a step of the environment, without resets; None where not timed."""
        return stats.median_of(self.step_ns) if self.is_timed else None

    @property
    def env_steps_per_s(self) -> float | None:
        return None if self.step is None else 1e9 / self.step.estimate

    @property
    def steps_per_s(self) -> float | None:
        """Steps of the engine per second; None also where a step has a varying number."""
        return self._engine_speed(self.env_steps_per_s)

    def _engine_speed(self, env_steps_per_s: float | None) -> float | None:
        frame_skip = self.facts.frame_skip if self.facts else None
        return frame_skip and env_steps_per_s and env_steps_per_s * frame_skip

    @cached_property
    def _layer_times(self) -> LayerTimes | None:
        if not self.is_timed or self.timer_cost is None:
            return None
        added_ns = float(np.median(self.timer_ns))
        return LayerTimes(self.layers, self.step_ns, added_ns, self.timer_cost)

    @cached_property
    def layer_shares(self) -> Sequence[LayerShare]:
        return self._layer_times.shares() if self._layer_times else []

    @cached_property
    def timer(self) -> TimerEffect | None:
        return self._layer_times.timer() if self._layer_times else None

    @cached_property
    def reset(self) -> ResetTime | None:
        if self.facts is None or self.step is None:
            return None
        reset, length = stats.median_of(self.reset_ns), self.facts.episode_nstep
        steps_ns = (length or self.facts.nstep) * self.step.estimate
        share = reset.estimate / (reset.estimate + steps_ns)
        return ResetTime(reset, reset.estimate / length if length else None, share)

    @cached_property
    def physics_paths(self) -> Sequence[PhysicsPath]:
        loop_ns = next((each.ns for each in self.paths if each.path == paths.BASE), ())
        return [
            PhysicsPath(
                **vars(path),
                steps_per_s=self._engine_speed(path.env_steps_per_s),
                speedup=_speedup(self.compared_ns, path.ns),
                over_loop=_speedup(loop_ns, path.ns),
            )
            for path in (self.paths if self.is_timed else ())
        ]

    @property
    def median_cores(self) -> float | None:
        return float(np.median(self.cores)) if self.cores else None

    def statuses(self) -> list[Status]:
        check = [self.check.status] if self.check else []
        paths = [path.status for path in self.physics_paths]
        return [self.status, *check, *paths, *(form.status for form in self.vectors)]

    def share(self, layer: Layer) -> float:
        """Return the share of a layer; 0 where nothing belongs to it."""
        return next((each.share.estimate for each in self.layer_shares if each.layer == layer), 0.0)


def _speedup(baseline_ns: Sequence[float], ns: Sequence[float]) -> Interval | None:
    return stats.speedup_in_common(baseline_ns, ns) if baseline_ns and ns else None
