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
    COMPILE = "compile"
    """The time that tracing and compiling a model's steps takes once."""


class Measured(Enum):
    """How a metric is measured."""

    STEPS = auto()
    """The time of blocks of steps."""
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
      note: what else the help of `--metric` tells; empty for nothing.
      is_exact: whether it has no noise, so that one measurement is certain.
      of_functions: whether it is of a function of the user's code, too, whose calls are its steps.
      of_compiling_paths: whether it is of a model by a path that compiles, too.
      operation: the function of `operations` that prepares it; empty where it is not one.
      reads_source: whether it is of the file of a model, and not of the compiled model.
    """

    metric: Metric
    measured: Measured
    meaning: str
    suffix: str = ""
    more: str = "slower"
    less: str = "faster"
    refusal: str = ""
    note: str = ""
    is_exact: bool = False
    of_functions: bool = False
    of_compiling_paths: bool = False
    operation: str = ""
    reads_source: bool = False

    @property
    def is_of_steps(self) -> bool:
        """Whether it is the time of steps, or of calls of a function."""
        return self.measured == Measured.STEPS

    @property
    def is_of_memory(self) -> bool:
        return self.measured == Measured.MEMORY

    @property
    def compiles(self) -> bool:
        """Whether it is the time that a process takes to compile once."""
        return self.measured == Measured.COMPILATION

    @property
    def follows_placement(self) -> bool:
        """Whether it may depend on where machine code lies in memory."""
        return self.measured in (Measured.STEPS, Measured.OPERATION)

    @property
    def is_read_once(self) -> bool:
        """Whether a launch has one layout and one quad, because more would be the same again."""
        return self.measured in (Measured.MEMORY, Measured.COMPILATION)

    def outcome(self, verdict: Verdict) -> str:
        """Return a verdict in the words of this metric."""
        return {Verdict.SLOWER: self.more, Verdict.FASTER: self.less}.get(verdict, verdict.value)


def _operation(
    metric: Metric, operation: str, meaning: str, reads_source: bool = False
) -> MetricSpec:
    return MetricSpec(
        metric,
        Measured.OPERATION,
        meaning,
        f", {meaning}",
        refusal="does not step by a path",
        operation=operation,
        reads_source=reads_source,
    )


_ALL = (
    MetricSpec(
        Metric.TIME, Measured.STEPS, "the time of steps", of_functions=True, of_compiling_paths=True
    ),
    MetricSpec(
        Metric.INSTRUCTIONS,
        Measured.COUNTS,
        "the instructions of the engine",
        ", instructions",
        refusal="counts python_loop only",
        note="Instruction counts repeat within 0.1 %. They do not need a quiet machine, but they"
        " need valgrind, and --confidence, --precision, --budget and --as-shipped do not apply.",
        is_exact=True,
    ),
    _operation(Metric.LOAD, "load", "loading the model", reads_source=True),
    _operation(Metric.RESET, "reset", "mj_resetData"),
    _operation(Metric.RAYS, "cast_rays", "casting rays"),
    _operation(Metric.ROLLOUT, "call_rollout", "a call of rollout with 5 steps of each simulation"),
    _operation(
        Metric.BATCH, "call_batch", "a call of Batch.rollout with 5 steps of each simulation"
    ),
    MetricSpec(
        Metric.MEMORY,
        Measured.MEMORY,
        "the peak memory of a new process that loads the model and steps it",
        ", peak memory",
        "more memory",
        "less memory",
        refusal="steps by python_loop only",
        of_functions=True,
    ),
    MetricSpec(
        Metric.COMPILE,
        Measured.COMPILATION,
        "tracing and compiling the steps of a path that compiles, such as mjx",
        ", compiling",
        refusal="is of paths that compile only",
        of_compiling_paths=True,
    ),
)
METRICS: Mapping[Metric, MetricSpec] = {spec.metric: spec for spec in _ALL}
