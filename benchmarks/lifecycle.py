"""Everything around the steps: loading a model, MjData, ray casts, MjSpec, `import mujoco`."""

import copy
import functools

import mujoco
import numpy as np

from benchmarks import stored
from benchmarks.settings import Timed
from mjbench.simulation import models, workload

SMALL, BIG = "cartpole", "pile"
NGEOM, NRAY = 2000, 500


@functools.cache
def _model_and_data(name: str) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """Return a model and an MjData at its start state, the same ones in every sample."""
    model = stored.load(name)
    return model, workload.start_data(model)


class Load(Timed):
    """Time to parse and compile an MJCF file, in seconds."""

    params = [SMALL, BIG]
    param_names = ("model",)

    def setup(self, model: str) -> None:
        """Find the file, and check that this release loads it."""
        stored.load(model)
        self.file = str(models.resolve(model).path)

    def time_5_loads(self, model: str) -> None:
        """Call `MjModel.from_xml_path` 5 times, in seconds."""
        for _ in range(5):
            mujoco.MjModel.from_xml_path(self.file)

    time_5_loads.pretty_name = "5 × MjModel.from_xml_path"


class Data(Timed):
    """Time to create, reset and copy MjData, in seconds."""

    params = [SMALL, BIG]
    param_names = ("model",)

    def setup(self, model: str) -> None:
        """Load the model and create one MjData."""
        self.model, self.data = _model_and_data(model)

    def time_20_mjdata(self, model: str) -> None:
        """Create 20 MjData, in seconds."""
        for _ in range(20):
            mujoco.MjData(self.model)

    def time_1000_resets(self, model: str) -> None:
        """Call `mj_resetData` 1000 times, in seconds."""
        for _ in range(1000):
            mujoco.mj_resetData(self.model, self.data)

    def time_20_copies(self, model: str) -> None:
        """Copy an MjData 20 times by `copy.copy`, in seconds."""
        for _ in range(20):
            copy.copy(self.data)

    time_20_mjdata.pretty_name = "20 × MjData(model)"
    time_1000_resets.pretty_name = "1000 × mj_resetData"
    time_20_copies.pretty_name = "20 × copy.copy(MjData)"


class Ray(Timed):
    """Time to cast rays from 10 m above the model, downward within a narrow cone, in seconds."""

    params = ["humanoid", BIG]
    param_names = ("model",)

    def setup(self, model: str) -> None:
        """Compute the geoms' poses, and draw the directions of the rays."""
        self.model, self.data = _model_and_data(model)
        mujoco.mj_forward(self.model, self.data)
        self.origin = np.array([0.0, 0.0, 10.0])
        slopes = np.random.default_rng(0).uniform(-0.1, 0.1, (NRAY, 2))
        self.directions = np.column_stack([slopes, -np.ones(NRAY)])
        self.geomid = np.zeros(1, dtype=np.int32)

    def time_500_rays(self, model: str) -> None:
        """Call `mj_ray` 500 times, in seconds."""
        for direction in self.directions:
            mujoco.mj_ray(self.model, self.data, self.origin, direction, None, 1, -1, self.geomid)

    time_500_rays.pretty_name = "500 × mj_ray"


class Spec(Timed):
    """Time to build a model in Python through MjSpec, in seconds."""

    def setup(self) -> None:
        """Check that this release has MjSpec."""
        if not hasattr(mujoco, "MjSpec"):
            raise NotImplementedError("MjSpec exists from MuJoCo 3.2.0 on")

    def time_2000_geoms(self) -> None:
        """Add 2000 spheres to the world body and compile, in seconds."""
        spec = mujoco.MjSpec()
        for i in range(NGEOM):
            geom = spec.worldbody.add_geom()
            geom.type = mujoco.mjtGeom.mjGEOM_SPHERE
            geom.size = [0.1, 0.0, 0.0]
            geom.pos = [i, 0.0, 0.0]
        spec.compile()

    time_2000_geoms.pretty_name = "MjSpec: add 2000 geoms and compile"


class Import(Timed):
    """Time of `import mujoco` in a new interpreter, in seconds."""

    def timeraw_import(self) -> str:
        """Return the statement that asv times in an interpreter of its own, in seconds."""
        return "import mujoco"

    timeraw_import.pretty_name = "import mujoco"
