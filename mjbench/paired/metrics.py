"""What paired comparisons can compare: each metric is declared once, here.

It imports nothing heavy, because `mjbench --help` imports it.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum, StrEnum, auto

from mjbench.paired.outcomes import Verdict


class Metric(StrEnum):
    """What a comparison compares."""

    TIME = "time"
    """Of a block of steps."""
    P99 = "p99"
    """The time that 99 of 100 single steps of a block do not exceed."""
    INSTRUCTIONS = "instructions"
    """That the engine executes in a step."""
    LOAD = "load"
    """The time of `MjModel.from_xml_path`."""
    RESET = "reset"
    """The time of `mj_resetData`."""
    RAYS = "rays"
    """The time of `mj_ray`."""
    ROLLOUT = "rollout"
    """The time of a short call of `mujoco.rollout`."""
    BATCH = "batch"
    """The time of a short call of `mujoco.batch.Batch.rollout`."""
    MEMORY = "memory"
    """The peak of a new process that loads the model and steps it."""
    GROWTH = "growth"
    """What 1,000 steps add to the memory of a process."""
    ARENA = "arena"
    """The most that the arena of MjData holds at a time."""
    COMPILE = "compile"
    """The time that tracing and compiling a model's steps takes once."""


class Measured(Enum):
    """How a metric is measured."""

    STEPS = auto()
    """The time of blocks of steps."""
    SINGLE_STEPS = auto()
    """The time of each step of a block."""
    OPERATION = auto()
    """The time of blocks of an operation around the step (see `operations`)."""
    MEMORY = auto()
    """What a process that steps takes up."""
    COMPILATION = auto()
    """The time that a process takes to compile once."""
    COUNTS = auto()
    """Under Callgrind, and not in pairs of processes."""


@dataclass(frozen=True)
class MetricSpec:
    """A metric.

    Attributes:
      suffix: what follows the name of a comparison; empty for the usual metric.
      more: what the candidate does that is worse, such as `slower`.
      less: what it does that is better.
      refusal: why it is not of all paths; empty where it is.
      is_exact: whether it has no noise, so that one measurement is certain.
    """

    metric: Metric
    measured: Measured
    meaning: str
    suffix: str = ""
    more: str = "slower"
    less: str = "faster"
    refusal: str = ""
    is_exact: bool = False

    @property
    def follows_placement(self) -> bool:
        """Whether it may depend on where machine code lies in memory."""
        return self.measured in (Measured.STEPS, Measured.SINGLE_STEPS, Measured.OPERATION)

    def outcome(self, verdict: Verdict) -> str:
        """Return a verdict in the words of this metric."""
        return {Verdict.SLOWER: self.more, Verdict.FASTER: self.less}.get(verdict, verdict.value)


# Growth is compared as a ratio of sums with this many bytes: nothing may grow in the baseline.
GROWTH_UNIT_BYTES = 1_000_000


def _operation(metric: Metric, meaning: str) -> MetricSpec:
    return MetricSpec(
        metric, Measured.OPERATION, meaning, f", {meaning}", refusal="does not step by a path"
    )


_ALL = (
    MetricSpec(Metric.TIME, Measured.STEPS, "the time of steps"),
    MetricSpec(
        Metric.P99,
        Measured.SINGLE_STEPS,
        "the time that 99 of 100 single steps do not exceed",
        ", the slowest 1 % of steps",
        refusal="times single steps of python_loop only",
    ),
    MetricSpec(
        Metric.INSTRUCTIONS,
        Measured.COUNTS,
        "the instructions of the engine",
        ", instructions",
        refusal="counts python_loop only",
        is_exact=True,
    ),
    _operation(Metric.LOAD, "loading the model"),
    _operation(Metric.RESET, "mj_resetData"),
    _operation(Metric.RAYS, "casting rays"),
    _operation(Metric.ROLLOUT, "a call of rollout with 5 steps of each simulation"),
    _operation(Metric.BATCH, "a call of Batch.rollout with 5 steps of each simulation"),
    MetricSpec(
        Metric.MEMORY,
        Measured.MEMORY,
        "the peak memory of a new process that loads the model and steps it",
        ", peak memory",
        "more memory",
        "less memory",
        refusal="steps by python_loop only",
    ),
    MetricSpec(
        Metric.GROWTH,
        Measured.MEMORY,
        "how much memory 1,000 steps or calls add",
        ", growth of memory",
        "more growth",
        "less growth",
        refusal="steps by python_loop only",
    ),
    MetricSpec(
        Metric.ARENA,
        Measured.MEMORY,
        "the most that the arena of MjData holds at a time",
        ", arena",
        "larger arena",
        "smaller arena",
        refusal="steps by python_loop only",
        is_exact=True,
    ),
    MetricSpec(
        Metric.COMPILE,
        Measured.COMPILATION,
        "tracing and compiling the steps of a path that compiles, such as mjx",
        ", compiling",
        refusal="is of paths that compile only",
    ),
)
# Those of a function of the user's code, whose calls are its steps.
FUNCTION_METRICS = (Metric.TIME, Metric.MEMORY, Metric.GROWTH)
# Those of a model by a path that compiles.
COMPILING_METRICS = (Metric.TIME, Metric.COMPILE)
METRICS: Mapping[Metric, MetricSpec] = {spec.metric: spec for spec in _ALL}
