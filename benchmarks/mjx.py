"""MJX on a CPU: what compiling costs, what a steady step costs, and the same program by hand.

JAX runs in child processes, never beside the timing of anything else. asv measures mujoco-mjx of
the release with the JAX that asv.conf.json pins; releases that do not work with it are skipped.

asv imports this module in environments without mjbench's optional packages, so whatever needs those
is imported inside functions.
"""

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks import stored
from benchmarks.settings import Cached, Tracked, for_asv
from mjbench import paths
from mjbench.errors import MjbenchError, describe
from mjbench.host import isolate
from mjbench.measuring import timing
from mjbench.paths.accelerated import AcceleratedPath
from mjbench.simulation import reference_run, workload
from mjbench.status import Status

# Simulations of a block, and steps of each.
NBATCH, NSTEP = 1024, 20
# Pairs of blocks, one of each program. The ratios of the pairs of one run had a standard deviation
# of 8 % (2-core virtual machine), which the median of 240 brings down to about 0.7 %.
ROUNDS = 240
# Blocks that are timed; how far from C's a run may end, as a share of the largest value: far above
# what float32 rounds in 20 steps without contact, and far below what a step that is left out makes;
# and the seconds in which a child compiles and times. `mjbench compare` judges MJX part by part.
BLOCKS, TOLERANCE, LIMIT_S = 12, 1e-3, 300.0


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

    @for_asv(timeout=600)
    def setup_cache(self) -> MjxCache:
        """Measure each model and number of simulations once, in a child process."""
        return {case: _measured(*case) for case in itertools.product(*self.params)}

    def setup(self, cache: MjxCache, model: str, nbatch: int) -> None:
        """Skip what this release cannot do; fail for what should have been measured."""
        cache[model, nbatch].get()

    @for_asv(unit="ns", pretty_name="MJX, float32: a steady step of one simulation")
    def track_steady_ns_per_step(self, cache: MjxCache, model: str, nbatch: int) -> float:
        """Return nanoseconds per step of one simulation: the median block, compiled before."""
        block_s = float(np.median(cache[model, nbatch].get().block_s))
        return 1e9 * block_s / (nbatch * NSTEP)

    @for_asv(unit="s", pretty_name="MJX, float32: tracing and compiling")
    def track_compile_s(self, cache: MjxCache, model: str, nbatch: int) -> float:
        """Return seconds of tracing, lowering and compiling."""
        return cache[model, nbatch].get().compile_s


class ByHand(Tracked):
    """Throughput of the path `mjx` over that of a handwritten jit(vmap(scan(mjx.step)))."""

    timeout = 300

    def setup(self) -> None:
        """Check that MJX is installed."""
        _require_mjx()

    # it is of mjbench and not of a release, and takes a minute: pytest checks it, and asv does not
    @for_asv(
        skip_benchmark=True,
        unit="path/by hand",
        pretty_name="MJX: throughput over a program by hand",
    )
    def track_throughput_over_handwritten(self) -> float:
        """Return the ratio of throughputs; above 1 the path is faster.

        Both step 1024 cart-poles, in turns; the ratio is the median over rounds.
        """
        return isolate.call(
            compare_with_handwritten,
            _mjx_path(),
            NBATCH,
            NSTEP,
            ROUNDS,
            limit_s=self.timeout,
            environment=_mjx_path().environment(),
        )


def compare_with_handwritten(
    path: paths.SteppingPath, nbatch: int, nstep: int, rounds: int, channel: isolate.Channel
) -> float:
    """Time both programs in turns; return the path's throughput over the other's.

    Runs in a child process.
    """
    cartpoles = stored.stored_workload("cartpole", nbatch, nstep)
    prepared = path.prepare(cartpoles, {}, paths.Resources(cartpoles))
    path_s, handwritten_s = seconds_of_rounds(prepared, _handwritten(cartpoles), rounds).T
    return float(np.median(handwritten_s / path_s))


def seconds_of_rounds(
    prepared: paths.Prepared, handwritten: Callable[[], None], rounds: int
) -> np.ndarray:
    """Return (rounds, 2) seconds of a path's blocks, and of a handwritten program's beside them."""
    contenders = [
        timing.Contender(prepared.run, before=prepared.clear),
        timing.Contender(handwritten),
    ]
    count = 1 + rounds  # the first one warms up
    return np.array(list(timing.rounds(contenders, 0.0, count, count))[1:])


def _handwritten(cartpoles: workload.Workload) -> Callable[[], None]:
    """Return a program that steps a workload as a user of MJX would write it."""
    import jax
    from mujoco import mjx

    model, empty = mjx.put_model(cartpoles.model), mjx.make_data(cartpoles.model)
    fields = workload.fields(cartpoles.model, cartpoles.initial_state)
    start = {name: jax.numpy.array(fields[name]) for name in ("qpos", "qvel", "qacc_warmstart")}
    control = jax.numpy.array(cartpoles.step_control)

    def rollout(start: Any, control: Any) -> Any:
        def step(data: Any, ctrl: Any) -> Any:
            return mjx.step(model, data.replace(ctrl=ctrl)), None

        return jax.lax.scan(step, empty.replace(**start), control)[0]

    rollouts = jax.jit(jax.vmap(rollout))

    def run() -> None:
        jax.block_until_ready(rollouts(start, control))

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
    """Measure the path `mjx` in a child process."""
    try:
        _require_mjx()
        return isolate.call(
            compile_and_time,
            _mjx_path(),
            model,
            nbatch,
            NSTEP,
            limit_s=LIMIT_S,
            environment=_mjx_path().environment(),
        )
    except NotImplementedError as reason:
        return Cached(Status.UNAVAILABLE, str(reason))
    except MjbenchError as error:
        return Cached(Status.FAILED, str(error))


def compile_and_time(
    path: AcceleratedPath, model: str, nbatch: int, nstep: int, channel: isolate.Channel
) -> Cached[MjxTimes]:
    """Compile a path's program, and time blocks of it; runs in a child process.

    A release that fails before it has compiled does not work with this JAX.
    """
    simulations = stored.stored_workload(model, nbatch, nstep)
    try:
        if reason := path.unsuited(simulations, {}):
            return Cached(Status.UNAVAILABLE, reason)
        compiled = path.prepare(simulations, {}, paths.Resources(simulations))
    except Exception as error:
        return Cached(Status.UNAVAILABLE, describe(error))
    contender = timing.Contender(compiled.run, before=compiled.clear)
    _, *block_s = (timing.block_s(contender) for _ in range(1 + BLOCKS))  # the first one warms up
    ends = (reference_run.observe(simulations).final_state, compiled.final_states().values)
    c_state, state = (workload.fields(simulations.model, each) for each in ends)
    for name in ("qpos", "qvel"):
        largest = np.abs(c_state[name]).max()
        if not np.allclose(state[name], c_state[name], rtol=0, atol=TOLERANCE * largest):
            return Cached(Status.FAILED, f"{name} is not that of C after {nstep} steps")
    times = MjxTimes((compiled.trace_s or 0.0) + compiled.compile_s, block_s)
    return Cached(Status.OK, value=times)
