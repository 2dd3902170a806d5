"""Functions of the user's code in two environments: releases of MuJoCo, with packages beside them.

The code is the user's as it lies here, the same on both sides.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from mjbench.errors import InputError
from mjbench.paired import revision_sides
from mjbench.paired.function_pair import FunctionTarget, FunctionTargets
from mjbench.paired.revision_sides import FunctionName
from mjbench.paired.timed_function import CodeOrigin
from mjbench.releases import installs, packages, source_layout
from mjbench.releases.installs import ReleaseSpec


@dataclass(frozen=True)
class EnvironmentComparison:
    """Functions to compare in a baseline and in candidates; files are relative to the root."""

    baseline: ReleaseSpec
    candidates: Sequence[ReleaseSpec]
    functions: Sequence[FunctionName]
    cwd: Path

    @property
    def files(self) -> list[Path]:
        """The user's files that hold the functions, and the wheels that are named."""
        named = [self.root / each.file for each in self.functions if each.file is not None]
        specs = (self.baseline, *self.candidates)
        return [*dict.fromkeys(named), *(wheel for spec in specs for wheel in spec.files)]

    @property
    def root(self) -> Path:
        return Path(self.cwd.anchor)


def parse_functions(texts: Sequence[str], cwd: Path) -> list[FunctionName]:
    """Return the functions that texts name."""
    root = Path(cwd.anchor)
    functions = [revision_sides.parse_function(text, cwd, root) for text in dict.fromkeys(texts)]
    for each in functions:
        if each.file is not None and not (root / each.file).is_file():
            raise InputError(f"there is no file {root / each.file}")
    return functions


def install_all(comparison: EnvironmentComparison) -> list[FunctionTargets]:
    specs = (comparison.baseline, *comparison.candidates)
    origins = [install(spec) for spec in specs]
    return [
        (
            _target(comparison, function, comparison.baseline, origins[0]),
            _target(comparison, function, candidate, origin),
        )
        for candidate, origin in zip(comparison.candidates, origins[1:], strict=True)
        for function in comparison.functions
    ]


def install(spec: ReleaseSpec) -> CodeOrigin:
    """Install an environment that is missing; return where its packages must be imported from."""
    if spec.name == installs.INSTALLED:
        return CodeOrigin(frozenset(), (), "")
    folder = installs.install(spec).resolve()
    names = packages.modules(folder, packages.names_of(spec.beside))
    return CodeOrigin(names, (str(folder),), "")


def _target(
    comparison: EnvironmentComparison, function: FunctionName, spec: ReleaseSpec, origin: CodeOrigin
) -> FunctionTarget:
    root, cwd, text = comparison.root, comparison.cwd, None
    if function.file is not None:
        text = (root / function.file).read_bytes()
    source = revision_sides.function_source(
        function, text, root, root, source_layout.source_folders(cwd)
    )
    return FunctionTarget(function.text, None, "", replace(source, cwd=str(cwd)), origin, spec)
