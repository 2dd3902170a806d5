"""`mjbench.profile`: where the time of a model's steps goes; and its modes, which commands have."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from mjbench.api import model_sources
from mjbench.api.functions import with_options
from mjbench.api.result import Result
from mjbench.commands.profile import driver
from mjbench.commands.profile.measure import ProfiledSteps, ProfileRow
from mjbench.commands.profile.options import ProfileOptions
from mjbench.commands.profile.rendering import FrameTime

if TYPE_CHECKING:
    from mjbench.api.model_sources import Model


@dataclass(frozen=True, repr=False, eq=False)
class Profile(Result):
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


@with_options(ProfileOptions)
def profile(model: "Model", *, options: ProfileOptions) -> Profile:
    """Return where a step's time goes: engine stages, Python around it, rendering.

    The same as `mjbench profile`. All is measured in child processes.

    Args:
      model: a name as on the command line, a path, an MjModel or an MjSpec.

    Raises:
      InputError: there is no such model, it cannot be loaded, or it diverges.
      MachineError: a package is missing, or the process that steps crashed or hung.
      KeyboardInterrupt: Ctrl-C; no child process is left.
    """
    with model_sources.sources([model]) as sources:
        return Profile.of(driver.measurement(sources, options), options.wait)
