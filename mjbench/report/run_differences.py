"""How the measurements of one comparison differ from those of another, row by row."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from mjbench.comparison.records import MeasurementRecord
from mjbench.errors import InputError
from mjbench.instrument import stats
from mjbench.instrument.machine import Machine
from mjbench.instrument.runs import Run
from mjbench.instrument.stats import TimedBlocks
from mjbench.paired.records import Ratio
from mjbench.paths.accelerated import CPU
from mjbench.report.results import steps_per_block
from mjbench.simulation.accelerated_limits import Precision
from mjbench.status import Status

# What must not differ where something was compiled: what compiled it, and with which flags.
_COMPILERS = ("jax", "jaxlib", "warp-lang")
_COMPILER_FLAGS = ("XLA_FLAGS", "JAX_DEFAULT_MATMUL_PRECISION", "NVIDIA_TF32_OVERRIDE")


@dataclass(frozen=True)
class RunDifference:
    """One variant that was timed in both runs.

    Attributes:
      model: its name.
      path: the way of stepping.
      options: of the path.
      nbatch: simulations.
      status: `ok`, or `input` where the two cannot be compared.
      detail: why they cannot; empty when ok.
      ratio: new time of a step over old time.
    """

    model: str
    path: str
    options: Mapping[str, Any]
    nbatch: int | None
    status: Status = Status.OK
    detail: str = ""
    ratio: Ratio | None = None


def run_differences(old: Run, new: Run, across: bool) -> list[RunDifference]:
    """Return a row for every variant that was timed in both runs.

    Args:
      old: a run of `mjbench compare`.
      new: another.
      across: compare also what differs in identity (see `identity`).
    """
    old_by_key = {_key(record): record for record in _timed(old)}
    return [
        _difference(old_by_key[_key(record)], old, record, new, across)
        for record in _timed(new)
        if _key(record) in old_by_key
    ]


def identity(record: MeasurementRecord, machine: Machine) -> dict[str, object]:
    """Return what two measurements must share to be compared without being asked to.

    Precision and device (a CPU by its name); of what was compiled also the versions of its
    compilers, and the flags that change what they do.
    """
    device = record.device or CPU
    values: dict[str, object] = {
        "precision": record.precision or Precision.FLOAT64,
        "device": machine.cpu if device == CPU else device,
    }
    if record.is_accelerated:
        values |= {name: machine.versions.get(name) for name in _COMPILERS}
        values |= {name: machine.flags.get(name) for name in _COMPILER_FLAGS}
    return values


def _difference(
    old: MeasurementRecord, old_run: Run, new: MeasurementRecord, new_run: Run, across: bool
) -> RunDifference:
    status, detail, ratio = Status.OK, "", None
    try:
        if new.workload_digest != old.workload_digest:
            raise InputError("not comparable: their workloads differ")
        if new.returns != old.returns:
            raise InputError(f"not comparable: one returns {old.returns}, the other {new.returns}")
        # how many times faster the old one is: new time over old
        speedup = stats.unpaired(
            TimedBlocks(_step_s(new), identity(new, new_run.header.machine)),
            TimedBlocks(_step_s(old), identity(old, old_run.header.machine)),
            across,
        )
        ratio = Ratio(speedup.median, speedup.low, speedup.high)
    except InputError as error:
        status, detail = Status.INPUT, str(error)
    return RunDifference(new.model, new.path, new.options, new.nbatch, status, detail, ratio)


def _timed(run: Run) -> list[MeasurementRecord]:
    return [record for record in run.of_type(MeasurementRecord) if record.is_timed]


def _key(record: MeasurementRecord) -> tuple[str, str, str, int | None]:
    return record.model, record.path, repr(sorted(record.options.items())), record.nbatch


def _step_s(record: MeasurementRecord) -> Sequence[float]:
    steps = steps_per_block(record)
    return [seconds / steps for seconds in record.samples_s]
