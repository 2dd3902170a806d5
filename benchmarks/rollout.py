"""Many simulations at a time: `mujoco.rollout` and `mujoco.batch`, across threads and options.

64 simulations of 50 steps. Final states are compared with the plain loop's before any timing.
"""

from typing import Any

from benchmarks import stored
from benchmarks.settings import Timed

NBATCH, NSTEP = 64, 50
MODELS = ["cartpole", "humanoid"]


class _Many(Timed):
    def prepare(self, path: str, model: str, **options: Any) -> None:
        self.run = stored.prepared(path, (model, NBATCH, NSTEP), **options).run


class RolloutThreads(_Many):
    """`mujoco.rollout`, its pool kept, by number of threads."""

    params = (MODELS, [1, 2, 4, 16])
    param_names = ("model", "threads")

    def setup(self, model: str, threads: int) -> None:
        """Prepare the rollout."""
        self.prepare("rollout", model, threads=threads, pool="kept")

    def time_3200_steps(self, model: str, threads: int) -> None:
        """Roll out."""
        self.run()

    time_3200_steps.pretty_name = "rollout of 64 × 50 steps, by threads"


class RolloutChunks(_Many):
    """`mujoco.rollout` on two threads, by how many simulations a thread takes at a time."""

    params = (MODELS, [1, 16, 64])
    param_names = ("model", "chunk")

    def setup(self, model: str, chunk: int) -> None:
        """Prepare the rollout."""
        self.prepare("rollout", model, threads=2, pool="kept", chunk=chunk)

    def time_3200_steps(self, model: str, chunk: int) -> None:
        """Roll out."""
        self.run()

    time_3200_steps.pretty_name = "rollout of 64 × 50 steps on 2 threads, by chunk size"


class RolloutPool(_Many):
    """`mujoco.rollout` on two threads, its pool kept or made new by each call."""

    params = (MODELS, ["kept", "new"])
    param_names = ("model", "pool")

    def setup(self, model: str, pool: str) -> None:
        """Prepare the rollout."""
        self.prepare("rollout", model, threads=2, pool=pool)

    def time_3200_steps(self, model: str, pool: str) -> None:
        """Roll out."""
        self.run()

    time_3200_steps.pretty_name = "rollout of 64 × 50 steps on 2 threads, by pool"


class Batch(_Many):
    """`mujoco.batch.Batch` on two threads, MjData shared by a thread's simulations or kept."""

    params = (MODELS, ["shared", "persistent"])
    param_names = ("model", "data")

    def setup(self, model: str, data: str) -> None:
        """Prepare both calls."""
        self.prepare("batch_step", model, threads=2, data=data)
        self.step = self.run
        self.prepare("batch_rollout", model, threads=2, data=data)

    def time_3200_steps_by_step(self, model: str, data: str) -> None:
        """Step, as a closed loop does."""
        self.step()

    def time_3200_steps_by_rollout(self, model: str, data: str) -> None:
        """Roll out."""
        self.run()

    time_3200_steps_by_step.pretty_name = "Batch.step, 64 × 50 steps on 2 threads"
    time_3200_steps_by_rollout.pretty_name = "Batch.rollout, 64 × 50 steps on 2 threads"
