"""The tally of `benchmarks.studies.foreign`: how each model file ended, and why."""

import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING

from benchmarks.studies import tally_file
from benchmarks.studies.foreign_packages import Package, PackageFiles
from mjbench.errors import one_line
from mjbench.host.machine import Machine
from mjbench.status import Status

if TYPE_CHECKING:
    from mjbench.commands.compare.results import ModelResults
    from mjbench.verification.records import ModelRecord


class Outcome(StrEnum):
    """How one model file ended."""

    AGREES = "agrees"
    """Every path reached the reference's final states."""
    DISAGREES = "disagrees"
    REFUSED = "refused"
    """mjbench, or one of its paths, does not take the model, and says why."""
    FAILED = "failed"
    CRASHED = "crashed"
    TIMEOUT = "timeout"
    NOTHING_TO_STEP = "nothing to step"
    FILE_MISSING = "file missing"
    FILE_ELSEWHERE = "file elsewhere"
    NAME_MISSING = "name missing"
    REJECTED = "rejected"


# What the outcomes mean of files that are no whole model.
NO_MODEL: Mapping[Outcome, str] = {
    Outcome.NOTHING_TO_STEP: "MuJoCo loads it, but it has no degree of freedom to step",
    Outcome.FILE_MISSING: "it includes or loads a file that the wheel does not hold",
    Outcome.FILE_ELSEWHERE: "it includes or loads a file that the wheel holds in another folder",
    Outcome.NAME_MISSING: "it refers to an element or a default that it does not define",
    Outcome.REJECTED: "MuJoCo rejects it for another reason",
}
# The outcome that the statuses of a model's variants amount to: that of the first one present.
_OUTCOMES: Mapping[Status, Outcome] = {
    Status.CRASHED: Outcome.CRASHED,
    Status.TIMEOUT: Outcome.TIMEOUT,
    Status.DISAGREES: Outcome.DISAGREES,
    Status.FAILED: Outcome.FAILED,
    Status.INPUT: Outcome.REFUSED,
    Status.UNAVAILABLE: Outcome.REFUSED,
}
_CANNOT_LOAD = "MuJoCo cannot load it: "
# Begins the reason of a model on which rollouts end early: they stop at a warning of any kind.
STOPPED_BY = "MuJoCo warns"
_OPENED_FILE = re.compile(r"Error opening file '([^']+)'")
_UNKNOWN_NAME = re.compile(r"' not found in |unrecognized name '|unknown default class name '")


@dataclass(frozen=True)
class FileResult:
    """How one model file ended.

    Attributes:
      file: path in the wheel.
      detail: why it does not agree, or what was left out; empty where all agree.
      statuses: of each variant that was compared.
    """

    file: str
    outcome: Outcome
    detail: str = ""
    statuses: Mapping[str, Status] = field(default_factory=dict)


@dataclass(frozen=True)
class PackageTally:
    """How the model files of one package ended.

    Attributes:
      files: XML files whose first element is `mujoco`.
      models: those that are a whole model: MuJoCo loads them, and they have something to step.
      agree: models on which every path agrees; the next five count the others.
      disagree: models on which a path ends in other states.
      refused: models that mjbench or a path does not take.
      failed: models on which a path raised an error.
      crashed: models on which a process died.
      timeouts: models on which a process was silent for too long.
      urdf: URDF files, which are not compared.
      agreeing: files on which every path agrees with nothing left out.
      remarks: all other files, with the reason.
    """

    name: str
    version: str
    files: int
    models: int
    agree: int
    disagree: int
    refused: int
    failed: int
    crashed: int
    timeouts: int
    urdf: int
    agreeing: tuple[str, ...]
    remarks: tuple[FileResult, ...]

    @classmethod
    def of(cls, package: Package, urdf: int, results: Sequence[FileResult]) -> "PackageTally":
        """Return the tally of the results of a package's files."""
        count = Counter(result.outcome for result in results)
        plain = [r for r in results if r.outcome == Outcome.AGREES and not r.detail]
        return cls(
            package.name,
            package.version,
            files=len(results),
            models=sum(n for outcome, n in count.items() if outcome not in NO_MODEL),
            agree=count[Outcome.AGREES],
            disagree=count[Outcome.DISAGREES],
            refused=count[Outcome.REFUSED],
            failed=count[Outcome.FAILED],
            crashed=count[Outcome.CRASHED],
            timeouts=count[Outcome.TIMEOUT],
            urdf=urdf,
            agreeing=tuple(result.file for result in plain),
            remarks=tuple(result for result in results if result not in plain),
        )

    @property
    def results(self) -> list[FileResult]:
        """The results by file; statuses of those that agree with nothing left out are not kept."""
        plain = [FileResult(file, Outcome.AGREES) for file in self.agreeing]
        return sorted([*plain, *self.remarks], key=lambda result: result.file)


@dataclass(frozen=True)
class ForeignTally:
    """The tally of all packages.

    Attributes:
      date: of the newest run that contributed (UTC).
      machine: of the newest run, with its condition.
    """

    date: str
    mujoco: str
    mjbench: str
    nbatch: int
    nstep: int
    variants: tuple[str, ...]
    machine: Machine
    packages: tuple[PackageTally, ...]


def judge(files: PackageFiles, file: str, records: "ModelResults") -> FileResult:
    """Return how a file ended, from the records of its comparison."""
    model = records.model
    statuses = {_variant(m.path, m.options): m.status for m in records.measurements}
    if model.status == Status.INPUT:
        reason = model.detail.removeprefix(f"{model.model}: ").replace(f"{files.root}/", "")
        if reason.startswith(_CANNOT_LOAD):
            message = reason.removeprefix(_CANNOT_LOAD)
            return FileResult(file, _rejection(files.root, message), message)
        if reason.startswith("nothing to step"):
            return FileResult(file, Outcome.NOTHING_TO_STEP)
        return FileResult(file, Outcome.REFUSED, reason)
    for status, outcome in _OUTCOMES.items():
        ended_so = [m for m in records.measurements if m.status == status]
        if ended_so:
            where = _variant(ended_so[0].path, ended_so[0].options)
            others = f" (and {len(ended_so) - 1} more variants)" if len(ended_so) > 1 else ""
            detail = ended_so[0].detail.replace(f"{files.root}/", "")
            cause = _stopping_warning(model)
            return FileResult(
                file, outcome, one_line(f"{cause}{where}: {detail}{others}"), statuses
            )
    remarks = []
    if model.spread == 0.0:
        remarks.append("starts and controls do not differ between simulations")
    elif model.spread not in (None, 1.0):
        remarks.append(f"starts and controls spread {model.spread:g} times as wide as usual")
    if model.diverged:
        total = (model.nbatch or 0) + model.diverged
        remarks.append(f"{model.diverged} of {total} simulations diverged ({model.divergence})")
    remark = "; ".join(remarks)
    return FileResult(file, Outcome.AGREES, remark, statuses)


def _stopping_warning(model: "ModelRecord") -> str:
    """Return that rollouts stop at a warning, where MuJoCo raised one; empty otherwise."""
    if not model.warnings:
        return ""
    names = ", ".join(model.warnings)
    return f"{STOPPED_BY} ({names}), at which mujoco.rollout and Batch.rollout stop; "


def _variant(path: str, options: Mapping[str, object]) -> str:
    from mjbench.verification.plan import Variant

    return str(Variant(path, options))


def _rejection(root: Path, message: str) -> Outcome:
    """Return why MuJoCo cannot load a file that is not a whole model, from its message."""
    opened = _OPENED_FILE.search(message)
    if opened:
        name = PurePosixPath(opened[1].replace("\\", "/")).name
        is_elsewhere = any(path.name == name for path in root.rglob("*"))
        return Outcome.FILE_ELSEWHERE if is_elsewhere else Outcome.FILE_MISSING
    return Outcome.NAME_MISSING if _UNKNOWN_NAME.search(message) else Outcome.REJECTED


def merge_by_file(earlier: Iterable[FileResult], newer: Iterable[FileResult]) -> list[FileResult]:
    """Return the results by file, sorted; a newer one replaces the earlier one of its file."""
    by_file = {result.file: result for result in [*earlier, *newer]}
    return [by_file[file] for file in sorted(by_file)]


def load(file: Path) -> ForeignTally:
    """Return the tally of a JSON file."""
    return tally_file.load(file, ForeignTally, "foreign models")
