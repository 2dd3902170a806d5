"""What `mjbench tune` gains on twenty models, and whether its promises hold from further starts.

    python -m benchmarks.studies.tuning [MODEL …] [--budget SECONDS] [--page]

searches settings for the shipped models and for ten models of other packages, which it downloads
into the cache folder. Every recommendation is then run from starts that neither look of the search
had: its error must be no larger than promised, and free settings must still change no bit. It
writes results/tuning.json after each model, and its part of docs/results.md. Named models replace
their rows; `--page` only writes the page again. It takes about an hour, and needs the machine for
itself.

The exit code is 1 if a setting that is recommended first errs by more than promised, or a free one
changes a state; it is 0 otherwise.
"""

import math
import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path

import mujoco

from benchmarks.studies import foreign_packages, tally_command, tally_file, tuning_page
from benchmarks.studies.foreign_packages import PACKAGES
from mjbench.commands.tune.accuracy import SHARE
from mjbench.commands.tune.c_search import SearchPlan
from mjbench.commands.tune.measurements import CMeasurements
from mjbench.commands.tune.result import Accuracy, Effect, Recommendation, TuneRecord
from mjbench.commands.tune.setting_launch import SettingLaunchRequest
from mjbench.commands.tune.settings import label
from mjbench.errors import InputError
from mjbench.host import machine
from mjbench.paired.worker_pool import WorkerPool
from mjbench.releases import installs
from mjbench.simulation import models
from mjbench.simulation.models import ModelSource
from mjbench.simulation.starts import StartPlan
from mjbench.status import ExitCode, Status

ROOT = Path(__file__).resolve().parents[2]
TALLY = ROOT / "results" / "tuning.json"
BUDGET_S = 120.0
# Further looks at every recommendation, each from starts of its own.
LOOKS = 2
# Models of other packages: the package, and a file of its wheel.
FOREIGN = (
    ("gymnasium", "gymnasium/envs/mujoco/assets/ant.xml"),
    ("gymnasium", "gymnasium/envs/mujoco/assets/half_cheetah.xml"),
    ("gymnasium", "gymnasium/envs/mujoco/assets/humanoid.xml"),
    ("dm_control", "dm_control/suite/quadruped.xml"),
    ("dm_control", "dm_control/suite/humanoid_CMU.xml"),
    ("dm_control", "dm_control/suite/manipulator.xml"),
    ("robosuite", "robosuite/models/assets/robots/panda/robot.xml"),
    ("robosuite", "robosuite/models/assets/robots/spot/robot.xml"),
    ("metaworld", "metaworld/assets/sawyer_xyz/sawyer_door_pull.xml"),
    ("metaworld", "metaworld/assets/sawyer_xyz/sawyer_drawer.xml"),
)


@dataclass(frozen=True)
class Promise:
    """A recommendation, and how it did from further starts.

    Attributes:
      effect: on the motion, as promised.
      time_ratio: of a simulated second, over that with the present settings.
      error: of nine runs in ten, as a share of the motion, as promised; None where no setting that
        is faster changes the motion.
      later_effects: from further starts.
      later_nrun: from further starts, as `later_exceeding`.
      later_exceeding: runs whose error is larger than promised.
      is_best: whether it is what `mjbench tune` recommends first.
    """

    settings: str
    effect: Effect
    time_ratio: float
    error: float | None
    later_effects: Sequence[Effect]
    later_nrun: int
    later_exceeding: int
    is_best: bool

    @property
    def keeps_error(self) -> bool:
        """Whether nine runs in ten erred by no more than promised."""
        return self.later_exceeding <= (1 - SHARE) * self.later_nrun

    @property
    def keeps_effect(self) -> bool:
        """Whether it changed no more than promised, in each further look."""
        return all(effect.rank <= self.effect.rank for effect in self.later_effects)


@dataclass(frozen=True)
class TunedModel:
    """A model, and what was recommended for it.

    Attributes:
      package: `mjbench` for ours.
      present_error: of nine runs in ten with its present settings, as a share of the motion.
      withdrawn: recommendations that the search withdrew itself.
      seconds: that the search took.
    """

    model: str
    package: str
    status: Status
    detail: str
    present_error: float | None
    promises: Sequence[Promise]
    withdrawn: int
    tried: int
    seconds: float


@dataclass(frozen=True)
class TuningTally:
    """All models."""

    date: str
    mujoco: str
    processor: str
    budget_s: float
    models: Sequence[TunedModel]


def tuned(source: ModelSource, package: str, budget_s: float) -> TunedModel:
    """Search settings for a model, and run the recommendations from further starts."""
    from mjbench.commands.tune.driver import tune

    plan = SearchPlan(budget_s=budget_s)
    with WorkerPool() as pool:
        record = tune(pool, source, plan)
        if record.status == Status.INTERRUPTED:
            raise KeyboardInterrupt
        promises = checked(pool, source, record, plan)
    return TunedModel(
        source.name,
        package,
        record.status,
        record.detail,
        record.present.error.share if record.present and record.present.error else None,
        promises,
        len(record.withdrawn),
        len(record.attempts),
        round(record.seconds, 1),
    )


def checked(
    pool: WorkerPool, source: ModelSource, record: TuneRecord, plan: SearchPlan
) -> list[Promise]:
    """Return the recommendations of a search, with their errors from further starts."""
    promises = [_promise(each, each == record.best()) for each in record.front]
    if record.present is None:
        return promises
    measurements = CMeasurements(pool, source, StartPlan())
    settings = [tuple(each.settings) for each in record.front]
    for look in range(LOOKS):
        measurements.present(plan.trials(2 + look, record.present.ncontrol))
        if record.present.error is not None:
            measurements.reference(record.present.horizon_ncontrol)
        for number, attempt in enumerate(
            measurements.launch(SettingLaunchRequest(settings, nrun=None))
        ):
            promises[number] = _after(promises[number], attempt.accuracy)
    return promises


def _after(promise: Promise, accuracy: Accuracy | None) -> Promise:
    """Return a promise after a further look; settings that fail there break it."""
    if accuracy is None:
        return replace(promise, later_nrun=1, later_exceeding=1)
    limit = math.inf if promise.error is None else promise.error
    exceeding = sum(error > limit for error in accuracy.run_errors)
    return replace(
        promise,
        later_effects=[*promise.later_effects, accuracy.effect],
        later_nrun=promise.later_nrun + len(accuracy.run_errors),
        later_exceeding=promise.later_exceeding + exceeding,
    )


def _promise(each: Recommendation, is_best: bool) -> Promise:
    return Promise(
        label(each.settings),
        each.effect,
        each.ratio.estimate,
        each.error.share if each.error else None,
        [],
        0,
        0,
        is_best,
    )


def sources() -> Iterable[tuple[str, ModelSource]]:
    """Yield the package and the source of each model; download those of other packages."""
    for name in models.shipped():
        yield "mjbench", models.resolve(name)
    cache = installs.cache_folder() / "foreign"
    by_name = {package.name: package for package in PACKAGES}
    for package_name, file in FOREIGN:
        root = foreign_packages.fetch(by_name[package_name], cache)
        path = Path(file)
        stem = path.parent.name if path.stem == "robot" else path.stem
        yield str(by_name[package_name]), ModelSource(f"{package_name}:{stem}", root / file)


def load(file: Path = TALLY) -> TuningTally:
    """Return the tally of a JSON file."""
    return tally_file.load(file, TuningTally, "tuned models")


def save(tally: TuningTally) -> None:
    """Write the tally and the page."""
    tally_file.write(TALLY, tally)
    tuning_page.PART.write(tuning_page.lines(tally))


def run(names: Sequence[str], budget_s: float) -> TuningTally:
    """Search settings for models, and write the tally after each."""
    done = {model.model: model for model in (load().models if names and TALLY.exists() else ())}
    tally = None
    for package, source in sources():
        if names and source.name not in names:
            continue
        done[source.name] = tuned(source, package, budget_s)
        tally = TuningTally(
            datetime.now(UTC).date().isoformat(),
            mujoco.__version__,
            machine.describe().cpu,
            budget_s,
            list(done.values()),
        )
        save(tally)
        print(tuning_page.row(done[source.name]), flush=True)
    if tally is None:
        raise InputError(f"no model is named {', '.join(names)}")
    return tally


def main(arguments: Sequence[str] | None = None) -> ExitCode:
    """Run the command; return its exit code."""
    parser = tally_command.parser(__doc__)
    parser.add_argument("models", nargs="*")
    parser.add_argument("--budget", type=float, default=BUDGET_S, help="seconds of each search")
    parser.add_argument("--page", action="store_true", help="only write the page again")
    options = parser.parse_args(arguments)

    def action() -> ExitCode:
        if options.page:
            save(load())
            return ExitCode.OK
        return exit_code(run(options.models, options.budget))

    return tally_command.run("tuning", action, "the tally has what was searched")


def exit_code(tally: TuningTally) -> ExitCode:
    """Return whether all promises hold: a recommended error, and that free settings are free."""
    promises = [promise for model in tally.models for promise in model.promises]
    errors_hold = all(promise.keeps_error for promise in promises if promise.is_best)
    free_hold = all(promise.keeps_effect for promise in promises if promise.effect == Effect.FREE)
    return ExitCode.OK if errors_hold and free_hold else ExitCode.FINDING


if __name__ == "__main__":
    sys.exit(main())
