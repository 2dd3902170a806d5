"""Plans of a sampling planner: candidates from one state, rolled out, and the plan improved.

The cart-pole hangs down and must swing up, by MPPI with candidates of 200 steps, each control held
for 20. `mjbench plan` runs the closed loop, and compares what paths return.
"""

import numpy as np

from benchmarks import stored
from benchmarks.settings import Timed, for_asv
from mjbench import paths
from mjbench.comparison.sampling_planners import Planner, PlannerSettings, PlannerStates, SwingUp
from mjbench.simulation import compat
from mjbench.simulation.workload import Product, Workload

KNOTS, HOLD = 10, 20


class Planning(Timed):
    """Time of an MPPI plan for the swing-up of the cart-pole, by path and samples, in seconds."""

    params = (["python_loop", "rollout", "batch_rollout"], [32, 128])
    param_names = ("path", "samples")

    def setup(self, path: str, samples: int) -> None:
        """Prepare the path, and the planner at the start."""
        model, self.task = stored.load("cartpole"), SwingUp()
        self.data = self.task.start(model)
        nstate = compat.state_size(model)
        self.start = np.empty(nstate)
        compat.get_state(model, self.data, self.start)
        self.workload = Workload(
            model,
            np.tile(self.start, (samples, 1)),
            np.zeros((samples, KNOTS, model.nu)),
            HOLD,
            seed=0,
            returns=Product.TRAJECTORY,
        )
        self.columns = compat.state_columns(model, compat.FULLPHYSICS)
        stepping_path = paths.find(path)
        options = stepping_path.complete({})
        reason = stepping_path.unavailable() or stepping_path.unsuited(self.workload, options)
        if reason:
            raise NotImplementedError(reason)
        self.resources = paths.Resources(self.workload)
        self.prepared = stepping_path.prepare(self.workload, options, self.resources)
        low, high = model.actuator_ctrlrange.T
        settings = PlannerSettings(samples=samples, knots=KNOTS)
        self.planner = Planner(settings, np.array(self.data.ctrl), low, high)

    @for_asv(pretty_name="an MPPI plan for the cart-pole's swing-up")
    def time_1_plan(self, path: str, samples: int) -> None:
        """Improve the plan once, from the start, in seconds."""
        assert self.prepared.step_outputs is not None
        candidates = self.planner.candidates()
        self.workload.control[:] = candidates
        self.resources.changed()
        self.prepared.run()
        physics = self.prepared.step_outputs().state
        assert physics is not None
        states = PlannerStates.of(self.columns, physics)
        self.planner.improve(candidates, self.task.cost(states, candidates))

    def teardown(self, path: str, samples: int) -> None:
        """Stop pools."""
        if hasattr(self, "resources"):
            self.resources.close()
