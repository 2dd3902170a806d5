"""A measurement and what surrounds it: other measurements here, the host's share, its run file.

Commands and programs measure alike: a `Measurement` says what is to be measured, and a `Session` is
the time in which that happens. A command prints and stores each item as it comes; a program gets
all of them together (`mjbench.api.result`).
"""

import contextlib
import functools
from collections.abc import Callable, Collection, Generator, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Protocol, TypeVar

from mjbench.errors import (
    Failure,
    InputError,
    MjbenchError,
    failure_of,
    one_line,
    printable,
    wrong_argument,
)
from mjbench.host import disturbance, machine, neighbours
from mjbench.host.disturbance import Disturbance, Watch
from mjbench.host.machine import Machine
from mjbench.host.neighbours import Neighbour
from mjbench.measuring.budget import Budget
from mjbench.measuring.timing import Progress
from mjbench.releases.release_names import ReleaseSpec
from mjbench.results import runs
from mjbench.results.content import Section
from mjbench.results.run_writer import RunFile
from mjbench.results.runs import InputFile, Record, Run, RunHeader, as_stored
from mjbench.simulation.models import ModelSource
from mjbench.simulation.starts import StartPlan
from mjbench.status import FINISHED


class Observer:
    """Passes the progress of a measurement on to a function; commands show more."""

    def __init__(self, on_progress: Progress | None = None):
        if not (on_progress is None or callable(on_progress)):
            raise wrong_argument("on_progress", on_progress, "a function")
        self._on_progress = on_progress or (lambda name, share: None)

    def __call__(self, name: str, share: float) -> None:
        self._on_progress(name, share)

    def begin(self, phase: str) -> None:
        """Note in a line what begins now."""

    def go_on(self, phase: str) -> None:
        """Note how far that is."""

    def show(self, section: Callable[[], Section | None] | None) -> None:
        """Show what is known so far, until it is called again; None ends that."""


@dataclass(frozen=True)
class Item:
    """What came of one thing that was measured, such as a model.

    Attributes:
      records: among them may be some of a continued run.
      failure: why it could not be measured, in a line that names it; None where it was.
      is_part: whether people see what it comes to together with the item after it.
    """

    records: Sequence[Record] = ()
    failure: Failure | None = None
    is_part: bool = False


Items = Generator[Item, None, None]


@dataclass(frozen=True)
class Measurement:
    """What is to be measured, for a command or for a program.

    Attributes:
      arguments: stored in the run file's header: a dataclass or JSON-ready values.
      files: that are measured, such as models.
      measure: yields items as they are measured, until it is closed. It is given records that need
        not be measured again. It may raise KeyboardInterrupt, or end after a record that says so.
      select_finished: which records of a continued run are not measured again.
      notes: what makes the results unreliable here, a sentence each.
      record_types: of the records in a run file, by `type`; empty for those of the package.
    """

    command: str
    arguments: Any
    files: Sequence[Path]
    measure: Callable[[Sequence[Record], Observer], Items]
    select_finished: Callable[[Sequence[Record]], Sequence[Record]] = lambda records: records
    notes: Sequence[str] = ()
    record_types: Mapping[str, type] = field(default_factory=dict)


def input_files(
    sources: Sequence[ModelSource], releases: Sequence[ReleaseSpec], starts: StartPlan
) -> list[Path]:
    wheels = [wheel for release in releases for wheel in release.files]
    return [*(source.path for source in sources), *wheels, *starts.files]


class _Named(Protocol):
    @property
    def name(self) -> str: ...


_Thing = TypeVar("_Thing", bound=_Named)


def in_turn(
    things: Sequence[_Thing],
    measure: Callable[[_Thing, float, Progress], Item],
    budget: Budget,
    earlier: Sequence[Record],
    observer: Observer,
    attribute: str = "model",
) -> Items:
    """Yield what one thing after the other comes to; what is known of it is not measured again.

    Args:
      measure: gets the thing's seconds, and a function for its progress, which is called with
        a share of its work.
      attribute: of a record, has the name of the thing.
    """
    known: dict[str, list[Record]] = {}
    for record in earlier:
        known.setdefault(getattr(record, attribute), []).append(record)
    shares = budget.divided(sum(each.name not in known for each in things), observer.begin)
    for number, thing in enumerate(things):

        def on_progress(name: str, share: float, number: int = number) -> None:
            observer(name, (number + share) / len(things))

        on_progress(thing.name, 0.0)
        if thing.name in known:
            yield Item(known[thing.name])
        else:
            yield measure(thing, shares.next_s(), on_progress)


def of_each_model(
    command: str,
    sources: Sequence[ModelSource],
    starts: StartPlan,
    record_type: type[Any],
    measure: Callable[[ModelSource, float], Sequence[Record]],
    budget: Budget,
    arguments: Mapping[str, Any] | None = None,
) -> Measurement:
    """Return the measurement of one model after the other.

    Args:
      measure: gets the model's seconds, too.
      record_type: a model that fails has one record, of its name and the failure.
      arguments: for the run file's header, beside the models and their starts.
    """

    def measured(source: ModelSource, budget_s: float, _: Progress) -> Item:
        try:
            return Item(measure(source, budget_s))
        except MjbenchError as error:
            failure = failure_of_model(source.name, error)
            detail = failure.detail.removeprefix(f"{source.name}: ")
            record = record_type(model=source.name, status=failure.status, detail=detail)
            return Item([record], failure)

    names = {"models": [source.name for source in sources]}
    all_arguments = {**names, **(arguments or {}), "starts": starts}
    files = input_files(sources, [], starts)
    items = functools.partial(in_turn, sources, measured, budget)
    return Measurement(command, all_arguments, files, items, finished)


def finished(records: Sequence[Record]) -> list[Record]:
    """Return the records of a continued run that ended well, or would end in the same way again."""
    return [record for record in records if getattr(record, "status", None) in FINISHED]


def failure_of_model(name: str, error: MjbenchError) -> Failure:
    """Return how the measurement of a model failed, in a line that names it."""
    failure = failure_of(error)
    return Failure(failure.status, f"{name}: {failure.detail.removeprefix(f'{name}: ')}")


class Session:
    """The time in which something is measured; used as a context manager.

    Attributes:
      earlier: records of a continued run that are not measured again.
      records: those, and all that were measured since.
    """

    header: RunHeader

    def __init__(
        self,
        measurement: Measurement,
        wait: bool | None = False,
        folder: Path | None = None,
        resume: Path | None = None,
        command_line: Sequence[str] = (),
        report: Callable[[str], None] = lambda line: None,
    ):
        """Prepare to measure.

        Args:
          wait: whether to wait for another mjbench that measures here, and not to warn; None where
            no time is measured.
          folder: for a new run file; None to store no records.
          resume: run file to continue instead.
          command_line: the words after `mjbench`.
          report: called at once with what people should know, in a line.
        """
        self.earlier: Sequence[Record] = ()
        self.records: list[Record] = []
        self._earlier_ids: Collection[int] = ()
        self._measurement, self._wait = measurement, wait
        self._folder, self._resume = folder, resume
        self._command_line, self._report = command_line, report
        self._file: RunFile | None = None

    def __enter__(self) -> "Session":
        """Begin to measure.

        Raises:
          InputError: the run to continue is not one of this command and this machine.
          MachineError: the run file cannot be written.
        """
        with contextlib.ExitStack() as closing:
            if self._wait is not None:
                self._watch = Watch(self._look(self._wait))
            self.header = self._new_header()
            if self._folder is not None:
                self._file = self._open(self._folder)
                closing.callback(self._file.close)
            self._closing = closing.pop_all()
        return self

    def __exit__(self, *exception: object) -> None:
        self._closing.close()

    def _look(self, wait: bool) -> Sequence[Neighbour]:
        """Return the other mjbench that measure now; `wait`: once there are none."""

        def on_wait(others: Sequence[Neighbour]) -> None:
            self._report(f"waiting for {neighbours.describe(others)} to finish measuring")

        if wait:
            neighbours.wait_for_others(on_wait)
            return []
        others = neighbours.measuring_now()
        if others:
            self._report(
                f"another mjbench is measuring on this machine ({neighbours.describe(others)}):"
                " timings of both are unreliable; use --wait to start after it"
            )
        return others

    def _new_header(self) -> RunHeader:
        return RunHeader(
            runs.SCHEMA,
            self._measurement.command,
            machine.describe(),
            runs.to_json(self._measurement.arguments),
            tuple(runs.InputFile.of(path) for path in dict.fromkeys(self._measurement.files)),
            tuple(map(printable, self._command_line)),
            datetime.now(UTC).isoformat(timespec="seconds"),
        )

    def _open(self, folder: Path) -> RunFile:
        """Begin a run file, or continue one with those of its records that are finished."""
        file = self._resume
        if file is None:
            return RunFile.create(folder, self.header)
        if file.is_fifo():
            raise InputError(f"cannot continue {file}: it is a pipe, not a file")
        stored = runs.load(file, self._measurement.record_types)
        check_continues(file, stored.header, self.header)
        self.header = stored.header
        if stored.is_torn:
            self._report(f"{file}: the last line was cut short; it is left out")
        disturbances = stored.of_type(Disturbance)
        measured = [each for each in stored.records if not isinstance(each, Disturbance)]
        self.earlier = tuple(self._measurement.select_finished(measured))
        self.records = [*self.earlier, *disturbances]
        self._earlier_ids = set(map(id, self.records))
        return RunFile.rewrite(file, stored.header, self.records)

    @property
    def file(self) -> Path | None:
        """The run file; None without one."""
        return None if self._file is None else self._file.path

    def record(self, record: Record) -> None:
        """Take a record, and append it to the run file, unless a continued run has it."""
        if id(record) in self._earlier_ids:
            return
        self.records.append(record)
        if self._file is not None:
            self._file.append(record)

    def run(self, records: Sequence[Record] | None = None) -> Run:
        return Run(self.header, tuple(self.records if records is None else records))

    def end(self) -> str:
        """Store what disturbed the run; return it as a sentence, empty where nothing did.

        Raises:
          MachineError: it cannot be stored.
        """
        if self._wait is None:
            return ""
        seen = self._watch.look()
        if seen.clauses:
            self.record(seen)
        return disturbance.sentence(seen.clauses)


def check_continues(path: Path, stored: RunHeader, now: RunHeader) -> None:
    """Refuse to continue a run by another command, with other files, or on another machine."""
    for name, contents in _contents(now.files).items():
        if _contents(stored.files).get(name) not in (None, contents):
            raise InputError(
                f"cannot continue {path}: {name} has changed since that run began; leave out"
                " --resume to begin a new one"
            )
    before, after = _identity(stored, now), _identity(now, stored)
    for key in {**before, **after}:
        if before.get(key) != after.get(key):
            old, new = _quoted(before.get(key)), _quoted(after.get(key))
            values = f"{key} {old}, and this command {new}" if old and new else f"other {key}"
            raise InputError(f"cannot continue {path}: that run has {values}")


def _identity(header: RunHeader, other: RunHeader) -> dict[str, Any]:
    """Return what must be the same for records to stand side by side."""
    machine = header.machine
    return {
        "the command": header.command,
        **_machine_name(machine, other.machine),
        **as_stored(header.arguments),
        "the files": [file.name for file in header.files],
        "the processor": machine.cpu,
        "usable cores": machine.usable_cores,
        "Python": machine.python,
        **machine.versions,
        **machine.flags,
    }


def _machine_name(machine: Machine, other: Machine) -> dict[str, str]:
    """Return what tells a machine from another of its kind: its label, else its host."""
    if machine.label and other.label:
        return {"the machine's label": machine.label}
    if machine.host and other.host:
        return {"the machine's host": machine.host}
    return {}


def _contents(files: Sequence[InputFile]) -> dict[str, str]:
    """Return the hash of each file, by its name; those of one name lie in different folders."""
    names = [file.name for file in files]
    return {
        name: " ".join(file.sha256 for file in files if file.name == name)
        for name in dict.fromkeys(names)
    }


def _quoted(value: Any) -> str:
    """Return a value for people; an empty text where it has parts that they do not read."""
    values = value if isinstance(value, list) else [] if value is None else [value]
    if any(isinstance(each, list | dict) for each in values):
        return ""
    return one_line(", ".join(map(str, values)) or "nothing", 80)
