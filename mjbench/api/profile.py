"""`mjbench.profile`: where the time of a model's steps goes; and its modes, which commands have."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from mjbench.api import model_sources
from mjbench.api.functions import with_options
from mjbench.api.result import Result
from mjbench.commands.profile import habit_timing, measure
from mjbench.commands.profile.habit_timing import OverheadRow
from mjbench.commands.profile.measure import ProfiledSteps, ProfileRow
from mjbench.commands.profile.options import HabitOptions, InstructionOptions, ProfileOptions
from mjbench.commands.profile.rendering import FrameTime
from mjbench.counts import instructions
from mjbench.counts.instructions import InstructionCounter
from mjbench.counts.records import counted
from mjbench.errors import MachineError
from mjbench.options import stored
from mjbench.releases import installs, release_names
from mjbench.results.runs import Record
from mjbench.session import Item, Items, Measurement, Observer, input_files, of_each_model
from mjbench.simulation.models import ModelSource

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
        return Profile.of(measurement(sources, options), options.wait)


def measurement(sources: Sequence[ModelSource], options: ProfileOptions) -> Measurement:
    """Return the measurement of where the time of each model's steps goes."""
    starts = options.starts

    def measure_model(source: ModelSource) -> list[ProfileRow]:
        return [measure.measure(source, options.time_limit_s, starts, options.budget_s)]

    return of_each_model("profile", sources, starts, ProfileRow, measure_model, stored(options))


def of_habits(sources: Sequence[ModelSource], options: HabitOptions) -> Measurement:
    """Return the measurement of what habits of a loop cost, `mjbench profile --habits`."""
    starts = options.starts

    def measure_model(source: ModelSource) -> list[OverheadRow]:
        limit_s, budget_s = options.time_limit_s, options.budget_s
        return [habit_timing.measure(source, limit_s, starts=starts, budget_s=budget_s)]

    return of_each_model("overhead", sources, starts, OverheadRow, measure_model, stored(options))


def of_instructions(sources: Sequence[ModelSource], options: InstructionOptions) -> Measurement:
    """Return the count of instructions per step, `mjbench profile --instructions`."""
    sizes, limit_s = options.sizes, options.time_limit_s
    specs = installs.parse_available(options.releases or (release_names.INSTALLED,))
    if problem := instructions.unavailable():
        raise MachineError(problem)

    def count_all(earlier: Sequence[Record], observer: Observer) -> Items:
        known = {(record.build, record.model) for record in counted(earlier)}
        remaining = {(spec.key, source.name) for spec in specs for source in sources} - known
        with InstructionCounter(sizes) as counter:
            for number, spec in enumerate(specs):
                names = {model for build, model in remaining if number == 0 or build == spec.key}
                to_count = [source for source in sources if source.name in names]
                for position, count in enumerate(counter.count(spec, to_count, limit_s), 1):
                    share = (number + position / len(to_count)) / len(specs)
                    observer(f"{count.model}, MuJoCo {spec.version}", share)
                    # the first release draws the work of models that remain for others, too
                    if (spec.key, count.model) in remaining:
                        yield Item([count.record()])

    arguments = {
        "sizes": sizes,
        "releases": [spec.key for spec in specs],
        "models": [source.name for source in sources],
    }
    files = input_files(sources, specs, sizes.starts)
    return Measurement("instructions", arguments, files, count_all, counted)
