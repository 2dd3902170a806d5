"""What follows from the samples of an environment: shares of its step, speeds, and speed-ups.

The timer of the layers costs time. What one of its calls costs beside this environment is the
median difference between the same step with and without it, divided by the calls; it is not taken
to be less than what a loop of such calls shows. Every layer is then without what its calls cost.
What the layers add up to, compared with steps that were timed as a whole, shows how well that
worked.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from mjbench import paths
from mjbench.environment.layers import Layer
from mjbench.environment.model_changes import ModelChange
from mjbench.environment.records import (
    EnvironmentFacts,
    EnvironmentRecord,
    LayerSamples,
    PhysicsCheck,
    VectorForm,
    VectorSamples,
)
from mjbench.instrument import stats
from mjbench.instrument.stats import Estimate
from mjbench.status import Status

# Smallest divisor; no clock shows a shorter time.
_LEAST_NS = 1e-3


@dataclass(frozen=True)
class FunctionRow:
    """A function inside a step.

    Attributes:
      name: of it, or of the wrapper's or environment's class.
      calls: per step of the environment.
      share: of the step, without other functions that are listed.
    """

    name: str
    calls: float
    share: float


@dataclass(frozen=True)
class LayerRow:
    """A layer of a step.

    Attributes:
      share: of the step; the shares of all layers add up to 1.
      functions: that belong to it, the one with the largest share first.
    """

    layer: Layer
    share: Estimate
    ns: float
    functions: Sequence[FunctionRow]


@dataclass(frozen=True)
class TimerRow:
    """What timing the layers cost.

    Attributes:
      calls: timed, per step of the environment.
      call_ns: what each costs.
      share: what all of them add to a step, of the step.
      sum: of the layers without that, over steps that were timed as a whole.
    """

    calls: float
    call_ns: float
    share: float
    sum: Estimate


@dataclass(frozen=True)
class ResetRow:
    """What a reset takes.

    Attributes:
      step_ns: per step of the environment, at the length that episodes had; None where none ended.
      episode_share: of the time of an episode of that length; where none ended, of all steps that
        were recorded, so that its share of an episode is less.
    """

    ns: Estimate
    step_ns: float | None
    episode_share: float


@dataclass(frozen=True)
class PhysicsPathRow:
    """The physics of an environment by a path; None is what was not measured.

    Attributes:
      closed_loop: whether a policy can choose each control.
      status: `ok`, or why it has no speed.
      env_steps_per_s: as many as the environment's steps have physics.
      steps_per_s: of the engine.
      speedup: over steps of the environment, round by round.
      over_loop: speed-up over the plain loop, round by round.
    """

    path: str
    options: Mapping[str, Any]
    closed_loop: bool
    status: Status
    detail: str
    env_steps_per_s: float | None = None
    steps_per_s: float | None = None
    speedup: Estimate | None = None
    over_loop: Estimate | None = None


@dataclass(frozen=True)
class VectorRow:
    """A vectorised form; None is what was not measured.

    Attributes:
      status: `ok`, or why it has no speed.
      env_steps_per_s: of all its environments together, resets included.
      speedup: over one environment, resets included, round by round.
      step_ns: of the time for each step, what the step itself takes on the cores that the form can
        use, if each is as fast as one alone; None where these are unknown.
      overhead_ns: the rest, which the form adds: it passes actions and results on.
      ncore: cores that it can use.
    """

    form: VectorForm
    nenv: int
    status: Status
    detail: str
    env_steps_per_s: float | None = None
    speedup: Estimate | None = None
    step_ns: float | None = None
    overhead_ns: float | None = None
    ncore: int | None = None


@dataclass(frozen=True, kw_only=True)
class EnvironmentRow:
    """What was measured of an environment, as people and programs read it; None: not measured.

    Attributes:
      environment: its name, as the user typed it.
      status: `ok`, or why it was not measured to the end.
      step_ns: of a step of the environment, without resets.
      env_steps_per_s: its inverse.
      steps_per_s: of the engine, in these.
      layers: of a step, the one with the largest share first.
      timer: what timing the layers cost.
      reset: what a reset takes.
      cores: that threads got, the median.
      no_vectors: why there are none; empty where there are.
    """

    environment: str
    status: Status
    detail: str
    facts: EnvironmentFacts | None = None
    check: PhysicsCheck | None = None
    changes: Sequence[ModelChange] = field(default=())
    rounds: int = 0
    step_ns: Estimate | None = None
    env_steps_per_s: float | None = None
    steps_per_s: float | None = None
    layers: Sequence[LayerRow] = field(default=())
    timer: TimerRow | None = None
    reset: ResetRow | None = None
    paths: Sequence[PhysicsPathRow] = field(default=())
    cores: float | None = None
    vectors: Sequence[VectorRow] = field(default=())
    no_vectors: str = ""

    def statuses(self) -> list[Status]:
        """Return how everything ended: the whole, its physics, its paths and vectorised forms."""
        check = [self.check.status] if self.check else []
        paths = [path.status for path in self.paths]
        return [self.status, *check, *paths, *(vector.status for vector in self.vectors)]

    def share(self, layer: Layer) -> float:
        """Return the share of a layer; 0 where nothing belongs to it."""
        return next((row.share.median for row in self.layers if row.layer == layer), 0.0)


def derive(record: EnvironmentRecord) -> EnvironmentRow:
    """Return the row of a record."""
    facts = record.facts
    row = EnvironmentRow(
        environment=record.environment,
        status=record.status,
        detail=record.detail,
        facts=facts,
        check=record.check,
        changes=record.changes,
    )
    if facts is None or not record.step_ns:
        return row
    step = _estimate(record.step_ns)
    speed = 1e9 / step.median
    frame_skip = facts.frame_skip
    layers = _Layers(record)
    return replace(
        row,
        rounds=len(record.step_ns),
        step_ns=step,
        env_steps_per_s=speed,
        steps_per_s=None if frame_skip is None else speed * frame_skip,
        layers=layers.rows(step.median),
        timer=layers.timer(),
        reset=_reset(record),
        paths=_paths(record),
        cores=float(np.median(record.cores)) if record.cores else None,
        vectors=_vectors(record),
        no_vectors=record.no_vectors,
    )


class _Layers:
    """The layers of a record, without what timing them cost."""

    def __init__(self, record: EnvironmentRecord):
        self._samples = record.layers
        self._plain_ns = np.array(record.step_ns)
        self._calls = sum(sample.timed_calls for sample in record.layers)
        cost = record.timer_cost
        assert cost is not None, "it was timed"
        added_ns = float(np.median(record.timer_ns))
        self._call_ns = max(cost.total_ns, added_ns / self._calls if self._calls else 0.0)
        inside = cost.inside_ns / cost.total_ns if cost.total_ns else 0.5
        self._inside_ns, self._outside_ns = inside * self._call_ns, (1 - inside) * self._call_ns

    def _ns(self, sample: LayerSamples) -> np.ndarray:
        """Return (rounds,) nanoseconds of a function, per step."""
        cost_ns = sample.timed_calls * self._inside_ns + sample.inner_calls * self._outside_ns
        return np.array(sample.ns) - cost_ns

    def rows(self, step_ns: float) -> list[LayerRow]:
        """Return the layers, the one with the largest share first.

        Shares are of medians over rounds, so that they add up.

        Args:
          step_ns: of a step that was timed as a whole.
        """
        total_ns, each_total = self._median_total(), self._total()
        by_layer: dict[Layer, list[LayerSamples]] = {}
        for sample in self._samples:
            by_layer.setdefault(sample.layer, []).append(sample)
        rows = []
        for layer, samples in by_layer.items():
            functions = [
                FunctionRow(s.name, s.calls, float(np.median(self._ns(s))) / total_ns)
                for s in samples
            ]
            functions.sort(key=lambda function: -function.share)
            in_rounds = sum(self._ns(sample) for sample in samples) / each_total
            share = _around(sum(function.share for function in functions), in_rounds)
            rows.append(LayerRow(layer, share, share.median * step_ns, functions))
        return sorted(rows, key=lambda row: -row.share.median)

    def _total(self) -> np.ndarray:
        """Return (rounds,) nanoseconds of all layers together; never 0, as it divides."""
        total = np.sum([self._ns(sample) for sample in self._samples], axis=0)
        return np.asarray(np.maximum(total, _LEAST_NS))

    def _median_total(self) -> float:
        """Return the sum of every function's median, in ns; never 0."""
        medians = [float(np.median(self._ns(sample))) for sample in self._samples]
        return max(_LEAST_NS, sum(medians))

    def timer(self) -> TimerRow:
        """Return what timing cost."""
        plain_ns = float(np.median(self._plain_ns))
        total = _around(self._median_total() / plain_ns, self._total() / self._plain_ns)
        return TimerRow(self._calls, self._call_ns, self._calls * self._call_ns / plain_ns, total)


def _reset(record: EnvironmentRecord) -> ResetRow:
    assert record.facts is not None, "it was timed"
    reset, length = _estimate(record.reset_ns), record.facts.episode_nstep
    steps_ns = (length or record.facts.nstep) * float(np.median(record.step_ns))
    share = reset.median / (reset.median + steps_ns)
    return ResetRow(reset, reset.median / length if length else None, share)


def _paths(record: EnvironmentRecord) -> list[PhysicsPathRow]:
    frame_skip = record.facts.frame_skip if record.facts else None
    loop_ns = next((samples.ns for samples in record.paths if samples.path == paths.BASE), ())
    rows = []
    for samples in record.paths:
        speed = speedup = over_loop = None
        if samples.ns:
            speed = 1e9 / float(np.median(samples.ns))
            speedup = stats.speedup_in_common(record.compared_ns, samples.ns)
            over_loop = stats.speedup_in_common(loop_ns, samples.ns) if loop_ns else None
        rows.append(
            PhysicsPathRow(
                samples.path,
                samples.options,
                samples.closed_loop,
                samples.status,
                samples.detail,
                speed,
                None if speed is None or frame_skip is None else speed * frame_skip,
                speedup,
                over_loop,
            )
        )
    return rows


def _vectors(record: EnvironmentRecord) -> list[VectorRow]:
    return [_vector(samples) for samples in record.vectors]


def _vector(samples: VectorSamples) -> VectorRow:
    row = VectorRow(samples.form, samples.nenv, samples.status, samples.detail)
    if not samples.ns:
        return row
    ns, single_ns = (float(np.median(each)) for each in (samples.ns, samples.single_ns))
    step_ns = single_ns / samples.ncore if samples.ncore else None
    return replace(
        row,
        env_steps_per_s=1e9 / ns,
        speedup=stats.speedup_in_common(samples.single_ns, samples.ns),
        step_ns=step_ns,
        overhead_ns=None if step_ns is None else ns - step_ns,
        ncore=samples.ncore,
    )


def _around(value: float, samples: np.ndarray) -> Estimate:
    """Return a value with the 95 % interval of the median of samples, widened to hold it."""
    low, high = stats.median_interval(samples)
    if low is None or high is None:
        return Estimate(value, None, None)
    return Estimate(value, min(low, value), max(high, value))


def _estimate(samples: Sequence[float] | np.ndarray) -> Estimate:
    """Return the median of samples with its 95 % interval."""
    values = np.asarray(samples, dtype=float)
    return Estimate(float(np.median(values)), *stats.median_interval(values))
