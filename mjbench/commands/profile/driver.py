"""Drivers of `mjbench profile`: stages of a step, habits of a loop, and instructions."""

from collections.abc import Sequence

from mjbench.commands.profile import habit_timing, measure
from mjbench.commands.profile.habit_timing import OverheadRow
from mjbench.commands.profile.measure import ProfileRow
from mjbench.commands.profile.options import HabitOptions, InstructionOptions, ProfileOptions
from mjbench.counts import instructions
from mjbench.counts.instructions import InstructionCounter
from mjbench.counts.records import InstructionsRecord
from mjbench.errors import MachineError
from mjbench.options import stored
from mjbench.releases import installs, release_names
from mjbench.results.runs import Record
from mjbench.session import Item, Items, Measurement, Observer, finished, input_files, of_each_model
from mjbench.simulation.models import ModelSource


def measurement(sources: Sequence[ModelSource], options: ProfileOptions) -> Measurement:
    """Return the measurement of where the time of each model's steps goes."""
    starts, budget = options.starts, options.budget

    def measure_model(source: ModelSource, budget_s: float) -> list[ProfileRow]:
        return [measure.measure(source, options.time_limit_s, starts, budget_s)]

    return of_each_model(
        "profile", sources, starts, ProfileRow, measure_model, budget, stored(options)
    )


def of_habits(sources: Sequence[ModelSource], options: HabitOptions) -> Measurement:
    """Return the measurement of what habits of a loop cost, `mjbench profile --habits`."""
    starts, limit_s, budget = options.starts, options.time_limit_s, options.budget

    def measure_model(source: ModelSource, budget_s: float) -> list[OverheadRow]:
        return [habit_timing.measure(source, limit_s, starts=starts, budget_s=budget_s)]

    return of_each_model(
        "overhead", sources, starts, OverheadRow, measure_model, budget, stored(options)
    )


def of_instructions(sources: Sequence[ModelSource], options: InstructionOptions) -> Measurement:
    """Return the count of instructions per step, `mjbench profile --instructions`."""
    sizes, limit_s = options.sizes, options.time_limit_s
    specs = installs.parse_available(options.releases or (release_names.INSTALLED,))
    if problem := instructions.unavailable():
        raise MachineError(problem)

    def count_all(earlier: Sequence[Record], observer: Observer) -> Items:
        known = {(r.build, r.model) for r in earlier if isinstance(r, InstructionsRecord)}
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
    return Measurement("instructions", arguments, files, count_all, finished)
