"""How often a model evaluates the dynamics: by its integrator in a step, and in a second.

These are counts: what a step takes has no part in them.
"""

from dataclasses import dataclass

import mujoco

from mjbench.bounds import PositiveInt, Timestep
from mjbench.formats import plain
from mjbench.simulation import compat

# RK4 evaluates the dynamics so often in a step.
_OF_RK4 = 4
# MuJoCo's own timestep, with which Euler evaluates the dynamics once in a step.
_DEFAULT_TIMESTEP_S = 0.002
# A model that evaluates the dynamics so many times as often as MuJoCo's defaults is worth a word.
_MANY_TIMES = 2.0


@dataclass(frozen=True)
class Evaluations:
    """How often a model evaluates the dynamics.

    Attributes:
      integrator: by MJCF's keyword, in lower case.
      of_step: evaluations of a step.
    """

    integrator: str
    of_step: PositiveInt
    timestep: Timestep

    @classmethod
    def of(cls, model: mujoco.MjModel) -> "Evaluations":
        integrator = compat.enum_name(mujoco.mjtIntegrator, model.opt.integrator, "mjINT_")
        return cls(integrator, _OF_RK4 if integrator == "rk4" else 1, float(model.opt.timestep))

    @property
    def sentence(self) -> str:
        """The integrator and the timestep, where they are what costs; "" where they are not."""
        per_s = self.of_step / self.timestep
        times = per_s * _DEFAULT_TIMESTEP_S
        if times < _MANY_TIMES:
            return ""
        name = "RK4" if self.integrator == "rk4" else self.integrator.capitalize()
        return (
            f"{name} at {plain(1e3 * self.timestep, 3)} ms evaluates the dynamics {per_s:,.0f}"
            f" times in a simulated second, {plain(times, 3)} × as often as MuJoCo's defaults"
            f" (Euler at {plain(1e3 * _DEFAULT_TIMESTEP_S, 3)} ms)"
        )
