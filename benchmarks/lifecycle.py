"""Everything around the steps: loading a model, MjData, ray casts, MjSpec, `import mujoco`."""

import copy
import functools
from collections.abc import Callable
from dataclasses import replace

import mujoco

from benchmarks import operations, stored
from benchmarks.settings import Timed, for_asv
from mjbench.errors import UnavailableError
from mjbench.simulation import workload

SMALL, BIG = "cartpole", "pile"


@functools.cache
def _start_data(name: str) -> mujoco.MjData:
    """Return an MjData at a model's start state, the same one in every sample."""
    return workload.start_data(stored.load(name))


def _block(name: str, repeats: int) -> Callable[[], None]:
    """Return what does an operation as many times, as `benchmarks.history measure` does it.

    A release that cannot do it skips the benchmark.
    """
    operation = replace(operations.registry()[name], repeats=repeats)
    try:
        if operation.model:
            stored.load(operation.model)
        return operation.prepared().run
    except UnavailableError as error:
        raise NotImplementedError(str(error)) from error


class Load(Timed):
    """Time to parse and compile an MJCF file, in seconds."""

    params = [SMALL, BIG]
    param_names = ("model",)

    def setup(self, model: str) -> None:
        """Find the file, and check that this release loads it."""
        self.run = _block(f"load {model}", 5)

    @for_asv(pretty_name="5 × MjModel.from_xml_path")
    def time_5_loads(self, model: str) -> None:
        """Call `MjModel.from_xml_path` 5 times, in seconds."""
        self.run()


class Data(Timed):
    """Time to create, reset and copy MjData, in seconds."""

    params = [SMALL, BIG]
    param_names = ("model",)

    def setup(self, model: str) -> None:
        """Load the model and create one MjData."""
        self.create, self.reset = _block(f"data {model}", 20), _block(f"reset {model}", 1000)
        self.data = _start_data(model)

    @for_asv(pretty_name="20 × MjData(model)")
    def time_20_mjdata(self, model: str) -> None:
        """Create 20 MjData, in seconds."""
        self.create()

    @for_asv(pretty_name="1000 × mj_resetData")
    def time_1000_resets(self, model: str) -> None:
        """Call `mj_resetData` 1000 times, in seconds."""
        self.reset()

    @for_asv(pretty_name="20 × copy.copy(MjData)")
    def time_20_copies(self, model: str) -> None:
        """Copy an MjData 20 times by `copy.copy`, in seconds."""
        for _ in range(20):
            copy.copy(self.data)


class Ray(Timed):
    """Time to cast rays from 10 m above the model, downward within a narrow cone, in seconds."""

    params = ["humanoid", BIG]
    param_names = ("model",)

    def setup(self, model: str) -> None:
        """Compute the geoms' poses, and draw the directions of the rays."""
        self.run = _block(f"rays {model}", 500)

    @for_asv(pretty_name="500 × mj_ray")
    def time_500_rays(self, model: str) -> None:
        """Call `mj_ray` 500 times, in seconds."""
        self.run()


class Spec(Timed):
    """Time to build a model in Python through MjSpec, in seconds."""

    def setup(self) -> None:
        """Check that this release has MjSpec."""
        self.run = _block("spec", 2000)

    @for_asv(pretty_name="MjSpec: add 2000 geoms and compile")
    def time_2000_geoms(self) -> None:
        """Add 2000 spheres to the world body and compile, in seconds."""
        self.run()


class Import(Timed):
    """Time of `import mujoco` in a new interpreter, in seconds."""

    @for_asv(pretty_name="import mujoco")
    def timeraw_import(self) -> str:
        """Return the statement that asv times in an interpreter of its own, in seconds."""
        return "import mujoco"
