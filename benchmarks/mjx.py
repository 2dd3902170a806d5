"""MJX on CPU JAX: what compiling costs, what a steady step costs, and the same written by hand.

JAX runs in processes of its own, never beside the timing of anything else. The history of
mujoco-mjx has an asv configuration of its own, with JAX pinned: benchmarks/asv.mjx.conf.json.
"""

import functools
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import stored
from benchmarks.settings import Tracked
from mjbench import paths
from mjbench.comparison import accelerated_run
from mjbench.errors import MachineError
from mjbench.instrument import isolate, timing
from mjbench.paths.accelerated import save_workload
from mjbench.simulation import models, work, workload

NBATCH, NSTEP = 1024, 100
# Of the contest with the program by hand: steps of a block, and pairs of blocks. The ratios of the
# pairs of one run had a standard deviation of 8 % (2-core virtual machine), which the median of 240
# brings down to about 0.7 %.
CONTEST_NSTEP, ROUNDS = 20, 240


class Mjx(Tracked):
    """MJX in float32 on models without contact, by number of simulations."""

    params = (["cartpole"], [1, 1024])
    param_names = ("model", "nbatch")
    timeout = 300

    def setup(self, model: str, nbatch: int) -> None:
        """See whether this release of MJX, this JAX and the model go together."""
        _needed()
        _measured(model, nbatch)

    def track_steady_ns_per_step(self, model: str, nbatch: int) -> float:
        """Time blocks of a compiled run."""
        return 1e9 * float(np.median(_measured(model, nbatch)["samples"])) / (nbatch * NSTEP)

    def track_compile_s(self, model: str, nbatch: int) -> float:
        """Time tracing, lowering and the compiler."""
        told = _measured(model, nbatch)
        return float(told["trace_s"] + told["compile_s"])

    track_steady_ns_per_step.unit = "ns"
    track_steady_ns_per_step.pretty_name = "MJX, float32: a steady step of one simulation"
    track_compile_s.unit = "s"
    track_compile_s.pretty_name = "MJX, float32: tracing and compiling"


class ByHand(Tracked):
    """Steady throughput of the path `mjx` beside that of jit(vmap(scan(mjx.step))) by hand."""

    timeout = 300

    def setup(self) -> None:
        """See whether MJX is there."""
        _needed()

    def track_throughput_over_handwritten(self) -> float:
        """Compare, in turns, on the cart-pole with 1024 simulations; above 1 is faster."""
        found: list[float] = []
        path = paths.find("mjx")
        ended = isolate.run(
            "benchmarks.mjx:contest",
            {"rounds": ROUNDS},
            lambda message: found.append(message["ratio"]),
            limit_s=self.timeout,
            environment=path.environment(),  # type: ignore[attr-defined]
        )
        if not found:
            raise MachineError(ended.detail)
        return found[0]

    track_throughput_over_handwritten.unit = "path/by hand"
    track_throughput_over_handwritten.pretty_name = "MJX: throughput over a program by hand"


def contest(request: dict[str, int], channel: isolate.Channel) -> None:
    """Send the ratio of throughputs, the median of so many `rounds`; runs in a child."""
    import jax
    from mujoco import mjx

    made = stored.stored_workload("cartpole", NBATCH, CONTEST_NSTEP)
    prepared = paths.find("mjx").prepare(made, {}, paths.Resources(made))
    model, hold = mjx.put_model(made.model), made.hold
    empty = mjx.make_data(made.model)
    fields = workload.fields(made.model, made.initial_state)
    start = {name: jax.numpy.array(fields[name]) for name in ("qpos", "qvel", "qacc_warmstart")}
    control = jax.numpy.array(np.repeat(made.control, hold, axis=1))

    @jax.jit
    @jax.vmap
    def rollout(start: Any, control: Any) -> Any:
        def step(data: Any, ctrl: Any) -> Any:
            return mjx.step(model, data.replace(ctrl=ctrl)), None

        return jax.lax.scan(step, empty.replace(**start), control)[0]

    def by_hand() -> None:
        jax.block_until_ready(rollout(start, control))

    contenders = [
        timing.Contender(prepared.clear, prepared.run, _nothing),
        timing.Contender(_nothing, by_hand, _nothing),
    ]
    most = 1 + request["rounds"]
    rounds = list(timing.rounds(contenders, 0.0, most, most))[1:]
    channel.send(ratio=float(np.median([hand / path for path, hand in rounds])))


def _nothing() -> None:
    pass


def _needed() -> None:
    reason = paths.find("mjx").unavailable()
    if reason:
        raise NotImplementedError(reason)


@functools.cache
def _measured(model: str, nbatch: int) -> dict[str, Any]:
    """Return what a child measured of the path `mjx`.

    Raises:
      NotImplementedError: this release of MJX, this JAX and the model do not go together.
      MachineError: they do, and it crashed, hung or went wrong.
    """
    told: dict[str, Any] = {"samples": []}

    def take(message: isolate.Message) -> None:
        if message["kind"] == "sample":
            told["samples"].append(message["seconds"])
        told.update(message)

    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "work.pickle"
        made = stored.stored_workload(model, nbatch)
        save_workload(made, work.observe(made).peaks, file)
        ended = accelerated_run.run(models.resolve(model), "mjx", {}, file, take)
    if told.get("status") == "unavailable" or (ended.status == "failed" and "trace_s" not in told):
        raise NotImplementedError(told.get("detail") or ended.detail)
    if ended.status != "ok" or told.get("status") != "ok":
        raise MachineError(ended.detail or told.get("detail", "MJX gave no figure"))
    return told
