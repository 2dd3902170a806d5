"""All that is faster and changes no result, in one: what it is, and what it gains as a whole."""

from collections.abc import Sequence
from pathlib import Path

from mjbench import paths
from mjbench.commands.checkup.result import Combination
from mjbench.commands.tune import edited_model
from mjbench.commands.tune.result import CONFIDENCE, MIN_EFFECT, Effect, Recommendation, TuneRecord
from mjbench.commands.tune.settings import NO_CHANGE, Edit, edits_of
from mjbench.errors import MachineError
from mjbench.host import isolate
from mjbench.host.isolate import Channel
from mjbench.paired import verdict
from mjbench.paired.race_record import Loop, RaceRecord
from mjbench.paired.records import VerdictRecord
from mjbench.paired.run_sizes import Sizes
from mjbench.paired.targets import Target
from mjbench.paired.verdict import VerdictPlan
from mjbench.paired.worker_pool import WorkerPool
from mjbench.releases import release_names
from mjbench.simulation import models
from mjbench.simulation.models import ModelSource
from mjbench.status import Status
from mjbench.verification.plan import Variant

# An option of paths whose processes have a timer of their own.
_OF_PROCESSES = "processes"


def free(record: TuneRecord | None) -> Recommendation | None:
    """Return the settings that changed no state; None without any."""
    front = record.front if record is not None else ()
    return next((each for each in front if each.effect == Effect.FREE), None)


def combined(race: RaceRecord | None, tuned: TuneRecord | None) -> Combination:
    """Return the fastest way of stepping with the settings that change nothing.

    It is the plain loop with the timer where nothing is certainly faster.
    """
    variant = Variant(paths.BASE, {})
    if race is not None and Loop.OPEN in race.standings:
        variant = race.variants[race.advised(race.standings[Loop.OPEN])]
    recommended = free(tuned)
    settings = recommended.settings if recommended else ()
    if variant.path != paths.BASE:  # states that are stored do not hold what sleeps
        settings = [each for each in settings if each.knob != "sleep"]
    pays = race is not None and race.timer_gain is not None
    turns_off = pays or any(each.loop.is_clock_off for each in settings)
    has_timer = not turns_off or _OF_PROCESSES in variant.options
    return Combination(variant, [s for s in settings if s.loop == NO_CHANGE], has_timer)


def measure(
    pool: WorkerPool,
    source: ModelSource,
    combination: Combination,
    sizes: Sizes,
    time_limit_s: float,
    limit_s: float,
) -> VerdictRecord:
    """Compare the combination with the plain loop and the model as it is.

    Args:
      time_limit_s: seconds from when the models are loaded.
      limit_s: a process that is silent for longer is killed.

    Raises:
      MachineError: a process failed.
      KeyboardInterrupt: the user stopped it.
    """
    release, candidate = release_names.parse_release(release_names.INSTALLED), source
    if edits := edits_of(combination.settings):
        file = pool.new_file(".mjb")
        isolate.call(_save, source, edits, file, limit_s=limit_s)
        candidate = ModelSource(source.name, file)
    path = paths.find(combination.variant.path)
    options = path.complete(dict(combination.variant.options))
    record = verdict.decide_pair(
        pool,
        Target(release, source, paths.BASE, paths.find(paths.BASE).complete({})),
        Target(release, candidate, path.name, options, has_timer=combination.has_timer),
        VerdictPlan(MIN_EFFECT, CONFIDENCE, MIN_EFFECT / 2, time_limit_s, sizes, as_shipped=True),
    ).uninterrupted()
    if record.status != Status.OK:
        raise MachineError(record.detail)
    return record


def _save(source: ModelSource, edits: Sequence[Edit], file: Path, channel: Channel) -> None:
    channel.doing("applying the settings")
    models.save(edited_model.compiled(source, edits), file)
