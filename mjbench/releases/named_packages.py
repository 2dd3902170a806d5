"""Packages that a user names beside a release of MuJoCo, and what an environment holds of them.

They are named as pip takes them, with commas: `jax==0.7.0,jaxlib==0.7.0`. Wheels may be among them,
and MuJoCo itself.
"""

import csv
import sys
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path, PurePosixPath

from packaging.requirements import InvalidRequirement, Requirement
from packaging.utils import canonicalize_name

from mjbench.errors import InputError, shown
from mjbench.releases import install_check, wheels

# What a requirement has that is neither a release nor a model.
_PINNED = "=="


@dataclass(frozen=True)
class NamedPackages:
    """What a user named with commas: perhaps a version or a wheel of MuJoCo, and other packages."""

    release: str
    requirements: tuple[str, ...]
    wheels: tuple[Path, ...]


def are_packages(text: str) -> bool:
    """Return whether an argument of the command line names packages, not a release alone."""
    parts = text.split(",")
    if _PINNED in text or (len(parts) > 1 and any(map(wheels.names_wheels, parts))):
        return True
    wheel = wheels.wheel_of(Path(text)) if text.endswith(".whl") else None
    return wheel is not None and wheel.project not in install_check.DISTRIBUTIONS


def parse(text: str) -> NamedPackages:
    """Return the packages that a text names; InputError for parts that pip cannot install."""
    release, requirements, files = "", list[str](), list[Path]()
    names = list[str]()
    for part in filter(None, map(str.strip, text.split(","))):
        if part.endswith(".whl"):
            wheel = wheels.named(part)
            names.append(wheel.project)
            if wheel.project == "mujoco":
                release = part
            else:
                files.append(wheel.file.resolve())
            continue
        requirement = _requirement(part)
        names.append(canonicalize_name(requirement.name))
        if names[-1] == "mujoco":
            release = _version(requirement)
        else:
            requirements.append(str(requirement))
    twice = next((name for name in names if names.count(name) > 1), "")
    if twice or not names:
        raise InputError(f"{shown(text)} names {twice + ' twice' if twice else 'no package'}")
    return NamedPackages(release, tuple(requirements), tuple(files))


def _requirement(part: str) -> Requirement:
    try:
        return Requirement(part)
    except InvalidRequirement:
        raise InputError(
            f"{shown(part)} is no package: give NAME==VERSION or a wheel, several with commas"
        ) from None


def _version(requirement: Requirement) -> str:
    pinned = [each.version for each in requirement.specifier if each.operator == _PINNED]
    if len(pinned) != 1:
        raise InputError(f"{requirement}: give one version, such as mujoco==3.5.0")
    return pinned[0]


def names_of(beside: Sequence[str]) -> frozenset[str]:
    """Return the names of the packages that requirements and paths of wheels stand for."""
    return frozenset(name for name in map(_name, beside) if name)


def _name(part: str) -> str:
    wheel = wheels.wheel_of(Path(part)) if part.endswith(".whl") else None
    try:
        return wheel.project if wheel else canonicalize_name(Requirement(part).name)
    except InvalidRequirement:
        return ""


def names_in(text: str) -> frozenset[str]:
    """Return the names of the packages in a text that `parse` accepts."""
    return names_of([part.strip() for part in text.split(",")])


def versions(folder: Path | None) -> dict[str, str]:
    """Return the version of each package in a folder, or in the environment of this process."""
    installed = metadata.distributions(path=sys.path if folder is None else [str(folder)])
    named = ((each.metadata["Name"], each.version) for each in installed)
    return {canonicalize_name(name): version for name, version in named if name}


def modules(folder: Path, names: Collection[str]) -> frozenset[str]:
    """Return the names of the modules at the top of packages that were installed into a folder."""
    module_names = set[str]()
    for each in metadata.distributions(path=[str(folder)]):
        if canonicalize_name(each.metadata["Name"] or "") not in names:
            continue
        rows = csv.reader((each.read_text("RECORD") or "").splitlines())
        tops = {PurePosixPath(row[0]) for row in rows if row and row[0].endswith((".py", ".so"))}
        module_names |= {path.parts[0].partition(".")[0] for path in tops}
    return frozenset(name for name in module_names if name.isidentifier())
