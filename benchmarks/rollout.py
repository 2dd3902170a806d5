"""Many simulations per call: `mujoco.rollout` and `mujoco.batch`, by threads and options.

Every method does 64 simulations of 50 steps. A rollout returns the state and the sensor data of
every step, a Batch final states. Their final states are compared with the plain loop's
before anything is timed.
"""

from typing import Any

from benchmarks import stored
from benchmarks.settings import Timed, for_asv
from mjbench.simulation.workload import Product

NBATCH, NSTEP = 64, 50
MODELS = ["cartpole", "humanoid"]


class _BatchBenchmark(Timed):
    def prepare(self, path: str, model: str, **options: Any) -> None:
        returns = Product.SENSORS if path == "rollout" else Product.FINAL
        self.run = stored.prepared_run(path, model, NBATCH, NSTEP, returns, **options).run


class RolloutThreads(_BatchBenchmark):
    """Time of `mujoco.rollout` with a reused thread pool, by number of threads, in seconds."""

    params = (MODELS, [1, 2, 4, 16])
    param_names = ("model", "threads")

    def setup(self, model: str, threads: int) -> None:
        """Start the pool and verify one call."""
        self.prepare("rollout", model, threads=threads, pool="kept")

    @for_asv(pretty_name="rollout of 64 × 50 steps, by threads")
    def time_3200_steps(self, model: str, threads: int) -> None:
        """Make one call of 64 × 50 steps, in seconds."""
        self.run()


class RolloutChunks(_BatchBenchmark):
    """Time of `mujoco.rollout` on two threads, by chunk size, in seconds.

    A chunk is the number of simulations that a thread takes at a time.
    """

    params = (MODELS, [1, 16, 64])
    param_names = ("model", "chunk")

    def setup(self, model: str, chunk: int) -> None:
        """Start the pool and verify one call."""
        self.prepare("rollout", model, threads=2, pool="kept", chunk=chunk)

    @for_asv(pretty_name="rollout of 64 × 50 steps on 2 threads, by chunk size")
    def time_3200_steps(self, model: str, chunk: int) -> None:
        """Make one call of 64 × 50 steps, in seconds."""
        self.run()


class RolloutPool(_BatchBenchmark):
    """Time of `mujoco.rollout` on two threads, with a reused pool or a new one, in seconds."""

    params = (MODELS, ["kept", "new"])
    param_names = ("model", "pool")

    def setup(self, model: str, pool: str) -> None:
        """Prepare the call and verify it."""
        self.prepare("rollout", model, threads=2, pool=pool)

    @for_asv(pretty_name="rollout of 64 × 50 steps on 2 threads, by pool")
    def time_3200_steps(self, model: str, pool: str) -> None:
        """Make one call of 64 × 50 steps, in seconds; `new` starts its threads in it."""
        self.run()


class Batch(_BatchBenchmark):
    """Time of `mujoco.batch.Batch` on two threads, in seconds, by what holds the MjData.

    `shared`: one MjData per thread, used for all of its simulations; `persistent`: one per
    simulation.
    """

    params = (MODELS, ["shared", "persistent"])
    param_names = ("model", "data")

    def setup(self, model: str, data: str) -> None:
        """Prepare both calls and verify them."""
        self.prepare("batch_step", model, threads=2, data=data)
        self.step = self.run
        self.prepare("batch_rollout", model, threads=2, data=data)

    @for_asv(pretty_name="Batch.step, 64 × 50 steps on 2 threads")
    def time_3200_steps_by_step(self, model: str, data: str) -> None:
        """Call `Batch.step` once per control, which is 10 steps of all 64, in seconds."""
        self.step()

    @for_asv(pretty_name="Batch.rollout, 64 × 50 steps on 2 threads")
    def time_3200_steps_by_rollout(self, model: str, data: str) -> None:
        """Make one call of `Batch.rollout`, in seconds."""
        self.run()
