"""Does `mjbench compare` advise on a busy machine what it advises on the quiet one?

    python -m benchmarks.studies.busy [MODEL …] [--budget-s 14] [--runs FOLDER] [--write]

compares each of our models on the machine as it is, for four times the budget and for the budget,
and beside each load of `LOADS`: programs that this one starts, and that end with it. Runs are
stored in FOLDER, and those that are there already are not repeated.

The table says for each load and both kinds of loop: by how much the best way of the quiet machine
is faster there than the way that is advised beside the load; and the speed-up of that way in both,
with the interval beside the load. Each is computed twice: from the faster half of the blocks of
every launch, and from the fastest block of a busy one, as `compare` does.
"""

import contextlib
import os
import random
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from benchmarks.studies import tally_command, tally_file
from benchmarks.studies.page_part import PagePart
from mjbench.commands.compare.results import ModelResults, derive_all
from mjbench.commands.show import kinds
from mjbench.errors import MachineError
from mjbench.host import child, machine
from mjbench.interval import Interval
from mjbench.paired.race_record import MARGIN, Loop, RaceRecord
from mjbench.results import runs
from mjbench.results.runs import Record
from mjbench.simulation import models
from mjbench.status import ExitCode

TALLY = Path(__file__).parents[2] / "results/busy.json"
PART = PagePart("method/timing.md", "busy", "benchmarks.studies.busy")
# Of each load: how many programs run, and the share of a core that each of them takes.
LOADS = {"none": (0, 0.0), "one": (1, 0.5), "two": (2, 0.5)}
# The run on the quiet machine that is the truth. It has more launches, so that its noise is small.
REFERENCE, _REFERENCE_BUDGETS = "reference", 4
# Runs for some milliseconds, and sleeps so long that it had its share.
_LOAD = """\
import random, sys, time
from mjbench.host import child, machine

child.die_with_parent(int(sys.argv[2]))
share = float(sys.argv[1])
while True:
    busy_s = random.uniform(0.002, 0.04)
    end = time.perf_counter() + busy_s
    while time.perf_counter() < end:
        pass
    time.sleep(busy_s * (1 - share) / share)
"""


@dataclass(frozen=True)
class Outcome:
    """What a comparison beside a load advises for one loop, against the quiet machine.

    Attributes:
      takes_fastest: whether the fastest block of a busy launch counts, or the faster half.
      quiet: speed-up of the advised way there.
      regret: share by which the best way is faster there than the advised one.
    """

    model: str
    load: str
    loop: Loop
    takes_fastest: bool
    advised: str
    regret: float
    quiet: Interval
    busy: Interval

    @property
    def is_good(self) -> bool:
        return self.regret <= MARGIN

    @property
    def holds(self) -> bool:
        return self.busy.covers(self.quiet.estimate)

    def line(self) -> str:
        good, holds = (("no", "yes")[answer] for answer in (self.is_good, self.holds))
        return (
            f"{self.model:18} {self.load:11} {self.loop:6} {self.advised:40}"
            f" best is {100 * self.regret:4.1f} % faster, within 5 %: {good:3}"
            f" speed-up {self.quiet.estimate:.2f}, busy {_written(self.busy)}, holds: {holds}"
        )


@dataclass(frozen=True)
class BusyTally:
    """All outcomes, and where they were measured."""

    mujoco: str
    cpu: str
    cores: int
    budget_s: float
    outcomes: Sequence[Outcome]

    def lines(self) -> Iterator[str]:
        """Yield the part of the page."""
        yield "| Programs | Faster half | Fastest block |"
        yield "|---|---|---|"
        for load in LOADS:
            yield f"| {load} | {self._cell(load, False)} | {self._cell(load, True)} |"

    def _cell(self, load: str, takes_fastest: bool) -> str:
        of_cell = [
            each
            for each in self.outcomes
            if each.load == load and each.takes_fastest == takes_fastest
        ]
        within, hold = sum(e.is_good for e in of_cell), sum(e.holds for e in of_cell)
        loss = 100 * statistics.mean(each.regret for each in of_cell)
        return f"{within}, {loss:.0f} %, {hold}"


@contextlib.contextmanager
def loaded(programs: int, share: float) -> Iterator[None]:
    """Have programs run beside the block, each for a share of the time of a core."""
    command = [sys.executable, "-c", _LOAD, str(share), str(os.getpid())]
    with contextlib.ExitStack() as ending:
        for _ in range(programs):
            ending.callback(child.Child(command).end)
        yield


def measure(names: Sequence[str], budget_s: float, folder: Path) -> None:
    """Store a comparison of each model beside each load."""
    for name in names:
        for load in random.sample([REFERENCE, *LOADS], 1 + len(LOADS)):
            if stored_file(folder, name, load) is not None:
                continue
            results = str(_results(folder, name, load))
            seconds = budget_s * (_REFERENCE_BUDGETS if load == REFERENCE else 1)
            command = ["compare", name, "--budget", f"{seconds}s", "--results", results]
            with loaded(*LOADS.get(load, LOADS["none"])):
                subprocess.run([sys.executable, "-m", "mjbench", *command], capture_output=True)
            if stored_file(folder, name, load) is None:
                raise MachineError(f"`mjbench {' '.join(command)}` stored nothing")


def stored_file(folder: Path, name: str, load: str) -> Path | None:
    """Return the run file of a comparison; None where there is none."""
    return next(_results(folder, name, load).glob("*.jsonl"), None)


def _results(folder: Path, name: str, load: str) -> Path:
    return folder / name / load


def read(file: Path, takes_fastest: bool) -> ModelResults:
    """Return a stored comparison, as it is or from the faster half of all blocks."""
    records: list[Record] = []
    for record in runs.load(file, kinds.RECORD_TYPES).records:
        if isinstance(record, RaceRecord) and not takes_fastest:
            launches = [replace(launch, other_cores=0.0) for launch in record.launches]
            record = replace(record, launches=launches)
        records.append(record)
    (results,) = derive_all(records)
    return results


def outcomes(folder: Path, name: str, takes_fastest: bool) -> list[Outcome]:
    """Return what comparisons of a model beside loads come to."""
    quiet_file = stored_file(folder, name, REFERENCE)
    if quiet_file is None:
        return []
    quiet, of_model = read(quiet_file, takes_fastest), []
    for load in LOADS:
        file = stored_file(folder, name, load)
        if file is None:
            continue
        for advice in read(file, takes_fastest).advice:
            speedups = _speedups(quiet, advice.loop)
            there = speedups[str(advice.variant)]
            regret = max(each.estimate for each in speedups.values()) / there.estimate - 1
            busy = advice.speedup or Interval(1.0, 1.0, 1.0)
            way = str(advice.variant)
            of_model.append(
                Outcome(name, load, advice.loop, takes_fastest, way, regret, there, busy)
            )
    return of_model


def _speedups(results: ModelResults, loop: Loop) -> dict[str, Interval]:
    """Return the speed-ups of the ways of stepping that compete for a loop, by their names."""
    assert results.race is not None, "the model was compared"
    race = results.race
    group = race.groups[list(Loop).index(loop)]
    known = ((str(race.variants[i]), race.speedups[i]) for i in group)
    return {name: speedup for name, speedup in known if speedup is not None}


def _written(interval: Interval) -> str:
    ends = (interval.low or 0.0, interval.high or float("inf"))
    return f"{interval.estimate:.2f} ({ends[0]:.2f}–{ends[1]:.2f})"


def main(arguments: Sequence[str] | None = None) -> ExitCode:
    """Compare models beside loads, and print what follows."""
    parser = tally_command.parser(__doc__)
    parser.add_argument("models", nargs="*", metavar="MODEL", help="default: all of ours")
    parser.add_argument("--budget-s", type=float, default=14.0, help="of each comparison")
    parser.add_argument("--write", action="store_true", help=f"write {TALLY.name} and the page")
    parser.add_argument("--runs", type=Path, metavar="FOLDER", help="default: a temporary one")
    options = parser.parse_args(arguments)

    def action() -> ExitCode:
        names = options.models or models.shipped()
        with tempfile.TemporaryDirectory() as temporary:
            folder = options.runs or Path(temporary)
            folder.mkdir(parents=True, exist_ok=True)
            measure(names, options.budget_s, folder)
            here = machine.describe()
            tally = BusyTally(
                here.versions["mujoco"],
                here.cpu,
                here.usable_cores,
                options.budget_s,
                [
                    each
                    for takes_fastest in (False, True)
                    for name in names
                    for each in outcomes(folder, name, takes_fastest)
                ],
            )
        print("\n".join((*(each.line() for each in tally.outcomes), *tally.lines())))
        if options.write:
            tally_file.write(TALLY, tally)
            PART.write(tally.lines())
        return ExitCode.OK

    return tally_command.run("busy", action, "finished comparisons are stored")


if __name__ == "__main__":
    sys.exit(main())
