"""Results of an incomplete run of `benchmarks.studies.foreign`: a line each, stored at once."""

import contextlib
import json
from dataclasses import dataclass
from pathlib import Path

from benchmarks.studies import tally_file
from benchmarks.studies.foreign_packages import Package
from benchmarks.studies.foreign_tally import FileResult
from mjbench.errors import writing


@dataclass(frozen=True)
class ProgressRecord:
    """A line of the file.

    Attributes:
      conditions: what the result depends on beside the package.
    """

    package: str
    conditions: str
    result: FileResult


class Progress:
    """The results that earlier runs of the same conditions stored, and those of this one."""

    def __init__(self, file: Path, conditions: str):
        """Read the file; drop records of other conditions, and a line that was cut short."""
        self._file, self._conditions = file, conditions
        records = [record for record in _read(file) if record.conditions == conditions]
        self._results = {(record.package, record.result.file): record.result for record in records}
        tally_file.replace(file, "".join(map(_line, records)))

    def result(self, package: Package, file: str) -> FileResult | None:
        """Return the stored result of a file, or None."""
        return self._results.get((str(package), file))

    def append(self, package: Package, result: FileResult) -> None:
        """Store a result."""
        with writing(self._file), self._file.open("a", encoding="utf-8") as stream:
            stream.write(_line(ProgressRecord(str(package), self._conditions, result)))

    def clear(self) -> None:
        """Remove the file: the run is complete."""
        with writing(self._file):
            self._file.unlink()


def _read(file: Path) -> list[ProgressRecord]:
    import msgspec

    records = []
    for line in file.read_bytes().splitlines() if file.is_file() else ():
        with contextlib.suppress(msgspec.MsgspecError, UnicodeDecodeError):
            records.append(msgspec.json.decode(line, type=ProgressRecord))
    return records


def _line(record: ProgressRecord) -> str:
    from mjbench.results.runs import to_json

    return json.dumps(to_json(record)) + "\n"
