"""The two sides of a comparison of functions: revisions of the user's code, or environments.

In revisions, the files of each side are written, and built where need be. In environments, releases
of MuJoCo with packages beside them, the code is the user's as it lies here, the same on both sides.
A process that times a side must have imported that side's code, else it is an `OtherCodeError`.
"""

import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from mjbench.errors import InputError, MachineError, shown
from mjbench.formats import count_of, listed
from mjbench.paired.records import TargetRow
from mjbench.paired.timed_function import MEASURING, CodeOrigin, FunctionFacts, FunctionSource
from mjbench.paired.worker_pool import WorkerPool
from mjbench.releases import installs, named_packages, release_names, revision_builds
from mjbench.releases.release_names import ReleaseSpec
from mjbench.releases.revisions import Repository, Revision
from mjbench.simulation.starts import Starts
from mjbench.status import ExitCode

# How a function of the user's code is named, for messages.
FORM = "FILE.py::FUNCTION, such as bench.py::step"


class OtherCodeError(MachineError):
    """What would have been measured is not the code of a revision (exit code 5)."""

    exit_code = ExitCode.OTHER_CODE


@dataclass(frozen=True)
class SteppedRun:
    """What a function does that steps a model."""

    path: str
    nbatch: int
    nstep: int
    starts: Starts


@dataclass(frozen=True)
class FunctionTarget:
    """A function in one revision, or in one environment: a release with packages beside it.

    Attributes:
      tree: the hash of the revision's files; empty where environments are compared.
    """

    function: str
    revision: Revision | None
    tree: str
    source: FunctionSource
    origin: CodeOrigin
    release: ReleaseSpec
    run: SteppedRun | None = None

    @property
    def path(self) -> str:
        return self.run.path if self.run else ""

    def name(self, role: str) -> str:
        """Return what error messages call it in a role, such as `baseline (main)`."""
        return f"{role} ({self.label})"

    @property
    def label(self) -> str:
        return self.revision.name if self.revision else self.release.label

    def row(self) -> TargetRow:
        return TargetRow(
            release=self.release.version,
            model=self.function,
            path=self.path,
            options={},
            model_options={},
            build=self.release.key,
            revision=self.revision.name if self.revision else "",
            commit=self.revision.commit if self.revision else "",
            tree=self.tree,
            packages=self.release.name if self.release.has_packages else "",
        )


FunctionTargets = tuple[FunctionTarget, FunctionTarget]


def check_origin(target: FunctionTarget, role: str, facts: FunctionFacts) -> None:
    """Refuse a side that imported other code than its revision's (OtherCodeError)."""
    if facts.misplaced:
        raise OtherCodeError(
            f"{target.name(role)} imported {facts.misplaced}, which is not the"
            f" {'revision' if target.revision else 'environment'}'s: uninstall an editable install"
            " of the package"
        )


def check_versions(baseline: FunctionFacts, candidate: FunctionFacts) -> None:
    """Refuse sides that ran on another Python, MuJoCo, NumPy or JAX (OtherCodeError)."""
    for name in baseline.versions.keys() & candidate.versions.keys():
        old, new = baseline.versions[name], candidate.versions[name]
        if old != new:
            raise OtherCodeError(f"the baseline ran on {name} {old}, the candidate on {new}")


@dataclass(frozen=True)
class FunctionName:
    """A function that a user named.

    Attributes:
      name: of the function, or `Class.method`.
      file: within the repository.
      content: of the file; None for that of the candidate.
    """

    text: str
    name: str
    file: Path
    content: bytes | None = None


@dataclass(frozen=True)
class RevisionComparison:
    """Functions to compare in two revisions.

    Attributes:
      own_files: whether each side runs its own file of a function.
    """

    repository: Repository
    baseline: Revision
    candidate: Revision
    functions: Sequence[FunctionName]
    cwd: Path
    own_files: bool = False

    @property
    def files(self) -> list[Path]:
        named = dict.fromkeys(each.file for each in self.functions)
        files = [self.repository.top / file for file in named]
        return [file for file in files if file.is_file()]

    @property
    def notes(self) -> list[str]:
        """What to know of the two revisions before their difference is read, a line each."""
        return [*self._lacking(), *self._changed_files()]

    def _lacking(self) -> Iterator[str]:
        lacking = self.repository.lacking(self.baseline, self.candidate)
        if not lacking:
            return
        names = ["HEAD" if r.is_worktree else r.name for r in (self.baseline, self.candidate)]
        commits = count_of(lacking, "commit")
        yield (
            f"{self.baseline.name} has {commits} that {self.candidate.name} lacks, and what"
            " they change counts, too; to leave it out, name what `git merge-base"
            f" {' '.join(names)}` prints"
        )

    def _changed_files(self) -> Iterator[str]:
        if self.own_files:
            return
        revisions = self.baseline, self.candidate
        for file in dict.fromkeys(function.file for function in self.functions):
            old, new = (self.repository.text(each, file) for each in revisions)
            if old is not None and new is not None and old != new:
                yield (
                    f"{file} itself differs, and both sides run that of {self.candidate.name}; with"
                    " --own-files, each side runs its own"
                )


def parse_function(text: str, cwd: Path, top: Path) -> FunctionName:
    """Return the function that a text names, such as `bench.py::step`.

    A file is looked for in the current folder, which lies in the repository `top`.
    """
    file, _, names = text.partition("::")
    if not file or not names or "[" in names:
        raise InputError(f"{shown(text)} is no function: give {FORM}")
    path = (cwd / file).resolve()
    if path.suffix != ".py":
        raise InputError(f"{shown(file)} is no Python file")
    if not path.is_relative_to(top.resolve()):
        raise InputError(f"{shown(file)} lies outside of the repository {top}")
    return FunctionName(text, names.replace("::", "."), path.relative_to(top.resolve()))


def parse_functions(texts: Sequence[str], cwd: Path, top: Path) -> list[FunctionName]:
    """Return the functions that texts name, each once."""
    return [parse_function(text, cwd, top) for text in dict.fromkeys(texts)]


def is_function(text: str) -> bool:
    """Return whether an argument of the command line is meant as a function."""
    return "::" in text


@dataclass(frozen=True)
class _Side:
    """One revision's files; `release` has the revision beside it where it is built."""

    revision: Revision
    folder: Path
    tree: str
    release: ReleaseSpec

    @property
    def is_built(self) -> bool:
        return bool(self.release.own_wheels)

    @property
    def code_folders(self) -> tuple[str, ...]:
        built = [installs.cache_folder() / self.release.key] if self.is_built else []
        return tuple(str(folder.resolve()) for folder in (self.folder, *built))


def check_out(
    pool: WorkerPool,
    comparison: RevisionComparison,
    on_phase: Callable[[str], None] = lambda text: None,
) -> list[FunctionTargets]:
    """Write the files of both revisions, which last as long as the pool; return all targets.

    Revisions are built where they have extension modules, or where they need other packages.

    Raises:
      InputError: a file that is named exists in neither the candidate nor the checkout; or they
        are revisions of mjbench.
      BuildError: a revision cannot be built.
    """
    root, work = pool.new_folder().resolve(), pool.new_folder()
    installed = release_names.parse_release(release_names.INSTALLED)
    sides = []
    # folders with names of one length, so that nothing in a process differs by it
    for name, revision in zip("ab", (comparison.baseline, comparison.candidate), strict=True):
        tree = comparison.repository.check_out(revision, root / name, work / name)
        sides.append(_Side(revision, root / name, tree, installed))
    own = frozenset().union(*(own_packages(side.folder) for side in sides))
    if "mjbench" in own:
        raise InputError(
            "mjbench cannot compare revisions of itself: processes that time functions import it"
        )
    if reason := build_reason(sides[0].folder, sides[1].folder):
        on_phase(f"building both revisions: {reason}")
        sides = [
            replace(side, release=revision_builds.built(side.revision, side.folder, side.tree))
            for side in sides
        ]
    elif changed := changed_locks(sides[0].folder, sides[1].folder):
        on_phase(f"both revisions run with what is installed here; other {listed(changed)}")
    return [_targets(comparison, function, sides, own) for function in comparison.functions]


def own_packages(tree: Path) -> frozenset[str]:
    """Return the names of packages and modules of a source tree that a process must import there.

    Packages that processes import to measure are the tree's own only where they lie directly in a
    source folder, not where they are copies of other projects.
    """
    copies = {name for name in MEASURING if not revision_builds.has_module(tree, name)}
    return revision_builds.package_names(tree) - sys.stdlib_module_names - copies


def build_reason(baseline: Path, candidate: Path) -> str:
    """Return why two source trees have to be built and installed; empty where they have not."""
    trees = baseline, candidate
    if not all(map(revision_builds.is_installable, trees)):
        return ""
    if any(map(revision_builds.is_compiled, trees)):
        return "there are extension modules"
    needs = set(map(revision_builds.dependencies, trees))
    return "they need other packages" if len(needs) > 1 else ""


def changed_locks(baseline: Path, candidate: Path) -> list[str]:
    """Return the names of files that pin versions, and are not the same in two source trees."""
    old, new = map(revision_builds.lock_files, (baseline, candidate))
    return sorted(name for name in {**old, **new} if old.get(name) != new.get(name))


def _targets(
    comparison: RevisionComparison,
    function: FunctionName,
    sides: Sequence[_Side],
    own: frozenset[str],
) -> FunctionTargets:
    """Return a function in both revisions: in the candidate's file, unless each has its own."""
    top, layout = comparison.repository.top.resolve(), sides[1].folder
    if comparison.own_files:
        files = [side.folder / function.file for side in sides]
        texts = [file.read_bytes() if file.is_file() else b"" for file in files]
    else:
        texts = [function.content or _text(top, layout, function.file)] * len(sides)
    baseline, candidate = (
        FunctionTarget(
            function.text,
            side.revision,
            side.tree,
            replace(
                function_source(
                    function, text, side.folder, layout, revision_builds.source_folders(side.folder)
                ),
                are_first=not side.is_built,
                cwd=str(_cwd(side.folder, comparison.cwd.relative_to(top))),
            ),
            CodeOrigin(own, side.code_folders, str(top)),
            side.release,
        )
        for side, text in zip(sides, texts, strict=True)
    )
    return baseline, candidate


def function_source(
    function: FunctionName, text: bytes, tree: Path, layout: Path, folders: Sequence[Path]
) -> FunctionSource:
    """Return where a process finds a function.

    Args:
      layout: tree by whose packages the file is imported as a module.
    """
    base, module = package_of(layout, function.file)
    unique = tuple(dict.fromkeys(map(str, [tree / base, *folders])))
    return FunctionSource(function.name, module, str(tree / function.file), text, unique)


def _cwd(folder: Path, place: Path) -> Path:
    return folder / place if (folder / place).is_dir() else folder


def _text(top: Path, candidate: Path, file: Path) -> bytes:
    """Return a file of the candidate; where it has none, that of the user's checkout."""
    for tree in (candidate, top):
        if (tree / file).is_file():
            return (tree / file).read_bytes()
    raise InputError(f"there is no file {file} in the candidate, nor in {top}")


def package_of(tree: Path, file: Path) -> tuple[Path, str]:
    """Return the folder below which a file's module is imported, and the name of the module."""
    folder, parts = file.parent, [file.stem]
    while folder != Path() and (tree / folder / "__init__.py").exists():
        parts.insert(0, folder.name)
        folder = folder.parent
    return folder, ".".join(parts)


@dataclass(frozen=True)
class EnvironmentComparison:
    """Functions to compare in environments, the baseline first; files are relative to the root."""

    specs: Sequence[ReleaseSpec]
    functions: Sequence[FunctionName]
    cwd: Path

    @property
    def files(self) -> list[Path]:
        """The user's files that hold the functions, and the wheels that are named."""
        named = [self.root / each.file for each in self.functions]
        return [*dict.fromkeys(named), *(wheel for spec in self.specs for wheel in spec.files)]

    @property
    def root(self) -> Path:
        return Path(self.cwd.anchor)


def install_all(comparison: EnvironmentComparison) -> list[FunctionTargets]:
    baseline, *candidates = [(spec, install(spec)) for spec in comparison.specs]
    return [
        (
            _target_in(comparison, function, *baseline),
            _target_in(comparison, function, *candidate),
        )
        for candidate in candidates
        for function in comparison.functions
    ]


def install(spec: ReleaseSpec) -> CodeOrigin:
    """Install an environment that is missing; return where its packages must be imported from."""
    if spec.name == release_names.INSTALLED:
        return CodeOrigin(frozenset(), (), "")
    folder = installs.install(spec).resolve()
    names = named_packages.modules(folder, named_packages.names_of(spec.beside))
    return CodeOrigin(names, (str(folder),), "")


def _target_in(
    comparison: EnvironmentComparison, function: FunctionName, spec: ReleaseSpec, origin: CodeOrigin
) -> FunctionTarget:
    root, cwd = comparison.root, comparison.cwd
    text = (root / function.file).read_bytes()
    source = function_source(function, text, root, root, revision_builds.source_folders(cwd))
    return FunctionTarget(function.text, None, "", replace(source, cwd=str(cwd)), origin, spec)
