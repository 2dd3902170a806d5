"""`mjbench.profile`: where the time of a model's steps goes."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from mjbench.api import checks, model_sources, start_states
from mjbench.api.measured import Measured
from mjbench.api.session import Measurement, of_each_model
from mjbench.limits import SECONDS, TIME_LIMIT_S
from mjbench.loop import profile as loop_profile
from mjbench.loop.profile import ProfiledSteps, ProfileRow
from mjbench.loop.rendering import FrameTime
from mjbench.simulation.models import ModelSource
from mjbench.simulation.starts import StartPlan

if TYPE_CHECKING:
    from mjbench.api.model_sources import Model
    from mjbench.api.start_states import States


@dataclass(frozen=True, repr=False, eq=False)
class Profile(Measured):
    """Where the time of a model's steps goes."""

    @property
    def row(self) -> ProfileRow:
        """All figures, as `mjbench profile --json` has them."""
        (row,) = self.run.of_type(ProfileRow)
        return row

    @property
    def steps(self) -> ProfiledSteps:
        """Times of a step, in nanoseconds, and the engine's stages."""
        steps = self.row.steps
        assert steps is not None, "what fails raises"
        return steps

    @property
    def frames(self) -> Sequence[FrameTime]:
        """What rendering a frame costs, by backend."""
        return self.row.frames or ()

    @property
    def stages(self) -> Mapping[str, float]:
        """The share of a step by stage of the engine; they sum up to 1."""
        return self.steps.stages


def profile(
    model: "Model",
    *,
    settle_s: float | None = None,
    states: "States | None" = None,
    budget_s: float = loop_profile.BUDGET_S,
    time_limit_s: float = TIME_LIMIT_S,
    wait: bool = False,
) -> Profile:
    """Return where a step's time goes: engine stages, Python around it, rendering.

    The same as `mjbench profile`. All is measured in child processes.

    Args:
      model: a name as on the command line, a path, an MjModel or an MjSpec.
      settle_s: simulated seconds for which the model moves before the first start state; None for
        its default.
      states: a file of start states, or arrays by MjData field, as `mjbench.record` returns and
        `mjbench.capture` stores them, instead; None for none.
      budget_s: seconds for the steps, and half of it for the frames of each backend.
      time_limit_s: a child process that reports nothing for this long is killed.
      wait: whether to wait until no other mjbench measures on this machine.

    Raises:
      InputError: there is no such model, it cannot be loaded, or it diverges.
      MachineError: a package is missing, or the process that steps crashed or hung.
      KeyboardInterrupt: Ctrl-C; no child process is left.
    """
    limit_s = checks.number("time_limit_s", time_limit_s, SECONDS)
    budget_s = checks.number("budget_s", budget_s, SECONDS)
    with (
        model_sources.sources([model]) as sources,
        start_states.plan(settle_s, states) as starts,
    ):
        return Profile.of(measurement(sources, starts, limit_s, budget_s), wait)


def measurement(
    sources: Sequence[ModelSource], starts: StartPlan, limit_s: float, budget_s: float
) -> Measurement:
    def measure_model(source: ModelSource) -> list[ProfileRow]:
        return [loop_profile.measure(source, limit_s, starts, budget_s)]

    arguments = {"budget_s": budget_s}
    return of_each_model("profile", sources, starts, ProfileRow, measure_model, arguments)
