"""Does `mjbench compare` advise on a busy machine what it advises on the quiet one?

    python -m benchmarks.studies.busy [MODEL …] [--budget-s 14] [--runs FOLDER] [--write]

compares each of our models beside each load of `LOADS`: programs that this one starts, and that end
with it. Runs are stored in FOLDER, and those that are there already are not repeated.

What is fastest on the quiet machine follows from the launches of `benchmarks.studies.races`, which
must be of the same machine. The table says for each load and both kinds of loop: by how much the
best path of the quiet machine is faster there than the one that is advised beside the load; and the
speed-up of that path in both, with the interval beside the load. Each is computed twice: from the
faster half of the blocks of every launch, and from the fastest block of a busy one, as `compare`
does.
"""

import contextlib
import os
import random
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from benchmarks.studies import races, tally_command, tally_file
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
# How many programs run, each for half the time of a core.
LOADS = {"none": 0, "one": 1, "two": 2}
# Runs for some milliseconds, and sleeps so long that it had its share.
_LOAD = """\
import random, sys, time
from mjbench.host import child

child.die_with_parent(int(sys.argv[1]))
while True:
    busy_s = random.uniform(0.002, 0.04)
    end = time.perf_counter() + busy_s
    while time.perf_counter() < end:
        pass
    time.sleep(busy_s)
"""


@dataclass(frozen=True)
class Outcome:
    """What a comparison beside a load advises for one loop, against the quiet machine.

    Attributes:
      takes_fastest: whether the fastest block of a busy launch counts, or the faster half.
      regret: share by which the best path is faster on the quiet machine than the advised one.
      quiet: speed-up of the advised path there.
    """

    model: str
    load: str
    loop: Loop
    takes_fastest: bool
    advised: str
    regret: float
    quiet: float
    busy: Interval

    @property
    def is_good(self) -> bool:
        return self.regret <= MARGIN

    @property
    def holds(self) -> bool:
        return self.busy.covers(self.quiet)

    def line(self) -> str:
        good, holds = (("no", "yes")[answer] for answer in (self.is_good, self.holds))
        return (
            f"{self.model:18} {self.load:11} {self.loop:6} {self.advised:40}"
            f" best is {100 * self.regret:4.1f} % faster, within 5 %: {good:3}"
            f" speed-up {self.quiet:.2f}, busy {_written(self.busy)}, holds: {holds}"
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
def loaded(programs: int) -> Iterator[None]:
    """Have programs run beside the block, each for half the time of a core."""
    command = [sys.executable, "-c", _LOAD, str(os.getpid())]
    with contextlib.ExitStack() as ending:
        for _ in range(programs):
            ending.callback(child.Child(command).end)
        yield


def measure(names: Sequence[str], budget_s: float, folder: Path) -> None:
    """Store a comparison of each model beside each load."""
    for name in names:
        for load in random.sample([*LOADS], len(LOADS)):
            if stored_file(folder, name, load) is not None:
                continue
            results = str(_results(folder, name, load))
            command = ["compare", name, "--budget", f"{budget_s}s", "--results", results]
            with loaded(LOADS[load]):
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


def outcomes(
    folder: Path, quiet: Mapping[str, float], name: str, takes_fastest: bool
) -> list[Outcome]:
    """Return what comparisons of a model beside loads come to.

    Args:
      quiet: speed-up of each path on the quiet machine.
    """
    of_model = []
    for load in LOADS:
        file = stored_file(folder, name, load)
        if file is None:
            continue
        results = read(file, takes_fastest)
        assert results.race is not None, "the model was compared"
        groups = dict(zip(Loop, results.race.groups, strict=True))
        for advice in results.advice:
            best = max(quiet[str(results.race.variants[i])] for i in groups[advice.loop])
            path = str(advice.variant)
            busy = advice.speedup or Interval(1.0, 1.0, 1.0)
            regret = best / quiet[path] - 1
            of_model.append(
                Outcome(name, load, advice.loop, takes_fastest, path, regret, quiet[path], busy)
            )
    return of_model


def quiet_speedups() -> dict[str, dict[str, float]]:
    """Return the speed-ups over the plain loop by model and path, of all stored launches."""
    _, records = races.load(races.SHIPPED.launches_file)
    return {
        record.model: dict(zip(map(str, record.variants), races.true_speedups(record), strict=True))
        for record in records
    }


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
            here, quiet = machine.describe(), quiet_speedups()
            tally = BusyTally(
                here.versions["mujoco"],
                here.cpu,
                here.usable_cores,
                options.budget_s,
                [
                    each
                    for takes_fastest in (False, True)
                    for name in names
                    for each in outcomes(folder, quiet[name], name, takes_fastest)
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
