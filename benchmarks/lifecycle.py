"""What surrounds the steps: loading, compiling, MjData, reset, copy, rays, MjSpec, the import."""

import copy
import functools
from typing import Any

import mujoco
import numpy as np

from benchmarks import stored
from benchmarks.settings import Timed
from mjbench.simulation import models, workload

SMALL, BIG = "cartpole", "pile"
GEOMS, NRAY = 2000, 500


@functools.cache
def _opened(name: str) -> tuple[str, Any, Any]:
    """Return a model's file, its MjModel and an MjData at its start."""
    model = stored.load(name)
    return str(models.resolve(name).path), model, workload.start_data(model)


class Load(Timed):
    """Parse and compile MJCF."""

    params = [SMALL, BIG]
    param_names = ("model",)

    def setup(self, model: str) -> None:
        """Find the file."""
        self.file, _, _ = _opened(model)

    def time_5_loads(self, model: str) -> None:
        """Load."""
        for _ in range(5):
            mujoco.MjModel.from_xml_path(self.file)

    time_5_loads.pretty_name = "5 × MjModel.from_xml_path"


class Data(Timed):
    """MjData: made, reset, copied."""

    params = [SMALL, BIG]
    param_names = ("model",)

    def setup(self, model: str) -> None:
        """Load."""
        _, self.model, self.data = _opened(model)

    def time_20_mjdata(self, model: str) -> None:
        """Make."""
        for _ in range(20):
            mujoco.MjData(self.model)

    def time_1000_resets(self, model: str) -> None:
        """Reset."""
        for _ in range(1000):
            mujoco.mj_resetData(self.model, self.data)

    def time_20_copies(self, model: str) -> None:
        """Copy."""
        for _ in range(20):
            copy.copy(self.data)

    time_20_mjdata.pretty_name = "20 × MjData(model)"
    time_1000_resets.pretty_name = "1000 × mj_resetData"
    time_20_copies.pretty_name = "20 × copy.copy(MjData)"


class Ray(Timed):
    """Rays from above the model, straight down and fanned out."""

    params = ["humanoid", BIG]
    param_names = ("model",)

    def setup(self, model: str) -> None:
        """Place the rays."""
        _, self.model, self.data = _opened(model)
        mujoco.mj_forward(self.model, self.data)
        self.origin = np.array([0.0, 0.0, 10.0])
        angles = np.random.default_rng(0).uniform(-0.1, 0.1, (NRAY, 2))
        self.directions = np.column_stack([angles, -np.ones(NRAY)])
        self.geomid = np.zeros(1, dtype=np.int32)

    def time_500_rays(self, model: str) -> None:
        """Cast."""
        for direction in self.directions:
            mujoco.mj_ray(self.model, self.data, self.origin, direction, None, 1, -1, self.geomid)

    time_500_rays.pretty_name = "500 × mj_ray"


class Spec(Timed):
    """A model built in Python through MjSpec."""

    def setup(self) -> None:
        """See whether there is MjSpec."""
        if not hasattr(mujoco, "MjSpec"):
            raise NotImplementedError("MjSpec exists from MuJoCo 3.2.0 on")

    def time_2000_geoms(self) -> None:
        """Add and compile."""
        spec = mujoco.MjSpec()
        for i in range(GEOMS):
            geom = spec.worldbody.add_geom()
            geom.type = mujoco.mjtGeom.mjGEOM_SPHERE
            geom.size = [0.1, 0.0, 0.0]
            geom.pos = [i, 0.0, 0.0]
        spec.compile()

    time_2000_geoms.pretty_name = "MjSpec: add 2000 geoms and compile"


class Import(Timed):
    """`import mujoco` in a new interpreter."""

    def timeraw_import(self) -> str:
        """Import."""
        return "import mujoco"

    timeraw_import.pretty_name = "import mujoco"
