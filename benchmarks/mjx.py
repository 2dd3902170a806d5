"""MJX on a CPU: what compiling costs, what a steady step costs, and the same program by hand.

JAX runs in child processes, never beside the timing of anything else. asv measures mujoco-mjx of
the release with the JAX that asv.conf.json pins; releases that do not work with it are skipped.

asv imports this module in environments without mjbench's optional packages, so whatever needs those
is imported inside functions.
"""

import itertools
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks import stored
from benchmarks.settings import Cached, Tracked
from mjbench import paths
from mjbench.errors import MachineError, MjbenchError
from mjbench.host import isolate
from mjbench.measuring import timing
from mjbench.paths.accelerated import AcceleratedPath, save_workload
from mjbench.simulation import models, work, workload
from mjbench.status import Status

if TYPE_CHECKING:
    from mjbench.comparison.records import MeasurementRecord

NBATCH, NSTEP = 1024, 100
# Of the comparison with the handwritten program: steps of a block, and pairs of blocks. The ratios
# of the pairs of one run had a standard deviation of 8 % (2-core virtual machine), which the median
# of 240 brings down to about 0.7 %.
HANDWRITTEN_NSTEP, ROUNDS = 20, 240


@dataclass(frozen=True)
class MjxTimes:
    """What was measured of the path `mjx` on one workload.

    Attributes:
      compile_s: seconds of tracing, lowering and compiling.
      block_s: seconds of each block of the compiled program.
    """

    compile_s: float
    block_s: Sequence[float]


# By model and number of simulations.
MjxCache = dict[tuple[str, int], Cached[MjxTimes]]


class Mjx(Tracked):
    """Compile time in seconds and time per step in nanoseconds of MJX in float32.

    Of many simulations under `vmap`, on a model without contact.
    """

    params = (["cartpole"], [NBATCH])
    param_names = ("model", "nbatch")

    def setup_cache(self) -> MjxCache:
        """Measure each model and number of simulations once, in a child process."""
        return {case: _measured(*case) for case in itertools.product(*self.params)}

    setup_cache.timeout = 600  # type: ignore[attr-defined]

    def setup(self, cache: MjxCache, model: str, nbatch: int) -> None:
        """Skip what this release cannot do; fail for what should have been measured."""
        cache[model, nbatch].get()

    def track_steady_ns_per_step(self, cache: MjxCache, model: str, nbatch: int) -> float:
        """Return nanoseconds per step of one simulation: the median block, compiled before."""
        block_s = float(np.median(cache[model, nbatch].get().block_s))
        return 1e9 * block_s / (nbatch * NSTEP)

    def track_compile_s(self, cache: MjxCache, model: str, nbatch: int) -> float:
        """Return seconds of tracing, lowering and compiling."""
        return cache[model, nbatch].get().compile_s

    track_steady_ns_per_step.unit = "ns"
    track_steady_ns_per_step.pretty_name = "MJX, float32: a steady step of one simulation"
    track_compile_s.unit = "s"
    track_compile_s.pretty_name = "MJX, float32: tracing and compiling"


class ByHand(Tracked):
    """Throughput of the path `mjx` over that of a handwritten jit(vmap(scan(mjx.step)))."""

    timeout = 300

    def setup(self) -> None:
        """Check that MJX is installed."""
        _require_mjx()

    def track_throughput_over_handwritten(self) -> float:
        """Return the ratio of throughputs; above 1 the path is faster.

        Both step 1024 cart-poles, in turns; the ratio is the median over rounds.
        """
        return isolate.call(
            compare_with_handwritten,
            NBATCH,
            HANDWRITTEN_NSTEP,
            ROUNDS,
            limit_s=self.timeout,
            environment=_mjx_path().environment(),
        )

    # it is of mjbench and not of a release, and takes a minute: pytest checks it, and asv does not
    track_throughput_over_handwritten.skip_benchmark = True  # type: ignore[attr-defined]
    track_throughput_over_handwritten.unit = "path/by hand"
    track_throughput_over_handwritten.pretty_name = "MJX: throughput over a program by hand"


def compare_with_handwritten(
    nbatch: int, nstep: int, rounds: int, channel: isolate.Channel
) -> float:
    """Time both programs in turns; return the path's throughput over the other's.

    Runs in a child process.
    """
    cartpoles = stored.stored_workload("cartpole", nbatch, nstep)
    prepared = _mjx_path().prepare(cartpoles, {}, paths.Resources(cartpoles))
    contenders = [
        timing.Contender(prepared.run, before=prepared.clear),
        timing.Contender(_handwritten(cartpoles)),
    ]
    count = 1 + rounds  # the first one warms up
    timed = list(timing.rounds(contenders, 0.0, count, count))[1:]
    return float(np.median([handwritten_s / path_s for path_s, handwritten_s in timed]))


def _handwritten(cartpoles: workload.Workload) -> Callable[[], None]:
    """Return a program that steps a workload as a user of MJX would write it."""
    import jax
    from mujoco import mjx

    model, empty = mjx.put_model(cartpoles.model), mjx.make_data(cartpoles.model)
    fields = workload.fields(cartpoles.model, cartpoles.initial_state)
    start = {name: jax.numpy.array(fields[name]) for name in ("qpos", "qvel", "qacc_warmstart")}
    control = jax.numpy.array(cartpoles.step_control)

    @jax.jit
    @jax.vmap
    def rollout(start: Any, control: Any) -> Any:
        def step(data: Any, ctrl: Any) -> Any:
            return mjx.step(model, data.replace(ctrl=ctrl)), None

        return jax.lax.scan(step, empty.replace(**start), control)[0]

    def run() -> None:
        jax.block_until_ready(rollout(start, control))

    return run


def _mjx_path() -> AcceleratedPath:
    path = paths.find("mjx")
    assert isinstance(path, AcceleratedPath)
    return path


def _require_mjx() -> None:
    reason = _mjx_path().unavailable()
    if reason:
        raise NotImplementedError(reason)


def _measured(model: str, nbatch: int) -> Cached[MjxTimes]:
    try:
        _require_mjx()
        return Cached(Status.OK, value=_measure(model, nbatch))
    except NotImplementedError as reason:
        return Cached(Status.UNAVAILABLE, str(reason))
    except MjbenchError as error:
        return Cached(Status.FAILED, str(error))


def _measure(model: str, nbatch: int) -> MjxTimes:
    """Measure the path `mjx` in a child process."""
    from mjbench.comparison import accelerated_run
    from mjbench.comparison.accelerated_run import AcceleratedRequest
    from mjbench.comparison.plan import Variant

    records: list[MeasurementRecord] = []
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "workload.pickle"
        stored_workload = stored.stored_workload(model, nbatch)
        save_workload(stored_workload, work.observe(stored_workload).peaks, file)
        # not named, so not compiled once more with a cache
        source, variant = models.resolve(model), Variant("mjx", {})
        request = AcceleratedRequest(source, variant, file, is_named=False)
        ended = accelerated_run.run(request, records.append)
    return times_from(records[-1] if records else None, ended)


def times_from(record: "MeasurementRecord | None", ended: isolate.Ended) -> MjxTimes:
    """Return the times of a path that agreed with C.

    Args:
      record: the last one that its child sent, if it sent any.
      ended: how the child ended.
    """
    if record is not None and record.status == Status.UNAVAILABLE:
        raise NotImplementedError(record.detail)
    if record is None and ended.status == Status.FAILED:
        raise NotImplementedError(ended.detail)
    ended.check()
    if record is not None and record.status != Status.OK:
        raise MachineError(record.detail)
    if record is None or record.compile_s is None or not record.samples_s:
        raise MachineError("the child process of MJX ended without a result")
    return MjxTimes((record.trace_s or 0.0) + record.compile_s, record.samples_s)
