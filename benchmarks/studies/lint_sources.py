"""What lint finds in the sources of packages that use MuJoCo.

    python -m benchmarks.studies.lint_sources [--read]

downloads the wheels of `PACKAGES` into the cache folder, checks every Python file in them, and
writes results/lint-sources.json and its part of docs/lint.md. Nothing in the wheels is executed.

It prints each finding that the tally does not have. If there is one, it writes nothing and exits
with 1: read them in their code, and give --read if none is false, as the page says.
"""

import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from benchmarks.studies import foreign_packages, tally_command, tally_file
from benchmarks.studies.foreign_packages import Package
from benchmarks.studies.page_part import PagePart
from mjbench.commands.lint import check as lint
from mjbench.commands.lint.script_files import script_files
from mjbench.commands.lint.settings import RuleChoice
from mjbench.releases import installs
from mjbench.status import ExitCode

TALLY = Path(__file__).resolve().parents[2] / "results" / "lint-sources.json"
PART = PagePart("lint.md", "sources", "benchmarks.studies.lint_sources")
PACKAGES = (
    Package("mujoco-core", "4.0.0"),
    Package("mujoco-mjx", "3.17.0"),
    Package("gymnasium", "1.4.0"),
    Package("gymnasium-robotics", "1.4.2"),
    Package("dm_control", "1.0.50"),
    Package("metaworld", "3.1.1"),
    Package("robosuite", "1.5.2"),
)


@dataclass(frozen=True)
class SourceFinding:
    """A finding; `file` is its path in the wheel."""

    file: str
    line: int
    code: str


@dataclass(frozen=True)
class SourceTally:
    """What lint finds in the Python files of a wheel, and how many these are."""

    package: Package
    files: int
    findings: tuple[SourceFinding, ...]


@dataclass(frozen=True)
class LintTally:
    """What lint finds in the wheels of all packages."""

    packages: tuple[SourceTally, ...]

    def __iter__(self) -> Iterator[tuple[Package, SourceFinding]]:
        """Yield each finding with its package."""
        return ((each.package, f) for each in self.packages for f in each.findings)


def tally_of(package: Package, root: Path) -> SourceTally:
    """Return what lint finds in a package whose wheel was unpacked in a folder."""
    files = script_files([str(root)])
    findings = [
        SourceFinding(Path(each.file).relative_to(root).as_posix(), each.line, each.code)
        for result in lint.check_all(files, RuleChoice())
        if isinstance(result, Sequence)
        for each in result
    ]
    return SourceTally(package, len(files), tuple(findings))


def lines(tally: LintTally) -> Iterator[str]:
    """Yield how many findings there are, and in what."""
    files = sum(each.files for each in tally.packages)
    names = ", ".join(each.package.name for each in tally.packages)
    yield (
        f"In {files:,} Python files of {names} (releases in `results/{TALLY.name}`), lint has"
        f" {len([*tally])} findings. Each was read in its code, and none is false."
    )


def main(arguments: Sequence[str] | None = None) -> ExitCode:
    """Run the command; return its exit code."""
    parser = tally_command.parser(__doc__)
    parser.add_argument("--read", action="store_true", help="all findings were read; none is false")
    options = parser.parse_args(arguments)

    def action() -> ExitCode:
        cache = installs.cache_folder() / "foreign"
        tally = LintTally(tuple(tally_of(p, foreign_packages.fetch(p, cache)) for p in PACKAGES))
        earlier = tally_file.load(TALLY, LintTally, "lint") if TALLY.exists() else LintTally(())
        new = [each for each in tally if each not in [*earlier]]
        for package, finding in new:
            print(f"{package}: {finding.file}:{finding.line} {finding.code}: read it")
        if new and not options.read:
            return ExitCode.FINDING
        tally_file.write(TALLY, tally)
        PART.write(lines(tally))
        return ExitCode.OK

    return tally_command.run("lint_sources", action)


if __name__ == "__main__":
    sys.exit(main())
