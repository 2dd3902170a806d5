"""`mjbench.profile`: where the time of a model's steps goes; and its modes, which commands have."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from mjbench.api import argument_values, model_sources, start_states
from mjbench.api.measured import Measured
from mjbench.api.session import Item, Items, Measurement, Observer, input_files, of_each_model
from mjbench.commands.profile import habit_timing
from mjbench.commands.profile import measure as loop_profile
from mjbench.commands.profile.habit_timing import OverheadRow
from mjbench.commands.profile.measure import ProfiledSteps, ProfileRow
from mjbench.commands.profile.rendering import FrameTime
from mjbench.counts import instructions
from mjbench.counts.instructions import InstructionCounter
from mjbench.counts.records import counted
from mjbench.errors import MachineError
from mjbench.limits import SECONDS, TIME_LIMIT_S
from mjbench.paired.run_sizes import Sizes
from mjbench.releases import installs, release_names
from mjbench.results.runs import Record
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
    limit_s = argument_values.number("time_limit_s", time_limit_s, SECONDS)
    budget_s = argument_values.number("budget_s", budget_s, SECONDS)
    with (
        model_sources.sources([model]) as sources,
        start_states.plan(settle_s, states) as starts,
    ):
        return Profile.of(measurement(sources, starts, limit_s, budget_s), wait)


def measurement(
    sources: Sequence[ModelSource], starts: StartPlan, limit_s: float, budget_s: float
) -> Measurement:
    """Return the measurement of where the time of each model's steps goes."""

    def measure_model(source: ModelSource) -> list[ProfileRow]:
        return [loop_profile.measure(source, limit_s, starts, budget_s)]

    arguments = {"budget_s": budget_s}
    return of_each_model("profile", sources, starts, ProfileRow, measure_model, arguments)


def of_habits(
    sources: Sequence[ModelSource], starts: StartPlan, limit_s: float, budget_s: float
) -> Measurement:
    """Return the measurement of what habits of a loop cost, `mjbench profile --habits`."""

    def measure_model(source: ModelSource) -> list[OverheadRow]:
        return [habit_timing.measure(source, limit_s, starts=starts, budget_s=budget_s)]

    arguments = {"budget_s": budget_s}
    return of_each_model("overhead", sources, starts, OverheadRow, measure_model, arguments)


def of_instructions(
    sources: Sequence[ModelSource], releases: Sequence[str], sizes: Sizes, limit_s: float
) -> Measurement:
    """Return the count of instructions per step, `mjbench profile --instructions`."""
    specs = installs.parse_available(releases or (release_names.INSTALLED,))
    if problem := instructions.unavailable():
        raise MachineError(problem)

    def measure(earlier: Sequence[Record], observer: Observer) -> Items:
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
    return Measurement("instructions", arguments, files, measure, counted)
