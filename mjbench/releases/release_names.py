"""Which release a name means, and which names mean none: versions, wheels, packages beside one."""

import bisect
import functools
import hashlib
import platform
import re
import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path

from packaging.version import InvalidVersion, Version

from mjbench.errors import InputError, MachineError, one_line, suggestion
from mjbench.formats import count_of
from mjbench.releases import install_check, named_packages, package_index, wheels
from mjbench.releases.release import OLDEST, version_key

# Names the release of the environment that mjbench runs in.
INSTALLED = "installed"
# Name the last release on the package index, and the one before it.
NEWEST, PREVIOUS = "newest", "previous"
NAMES = (INSTALLED, NEWEST, PREVIOUS)
# What a release can be, for messages.
FORMS = (
    f"a version such as 3.5.0, a wheel of mujoco, a folder of its wheels, `{INSTALLED}`,"
    f" `{NEWEST}` or `{PREVIOUS}`"
)
# No version has more characters; an install's name, of which it is part, must fit a file system.
_LONGEST_VERSION = 64

# How many other versions an error names.
_NEAREST = 4


@dataclass(frozen=True)
class ReleaseSpec:
    """A release that a user named, and what is installed beside it.

    Attributes:
      wheels: of the release; empty for a version of the index.
      own_wheels: of the user's code, or of packages that the user named.
    """

    name: str
    version: str
    wheels: tuple[Path, ...] = ()
    own_wheels: tuple[Path, ...] = ()
    requirements: tuple[str, ...] = ()
    has_packages: bool = False

    @functools.cached_property
    def key(self) -> str:
        """Return the name of its install: release, packages beside it, Python and NumPy."""
        if self.name == INSTALLED:
            return f"{INSTALLED}-{self.version}"
        content = hashlib.blake2b(digest_size=4)
        try:
            for wheel in self.files:
                content.update(wheel.read_bytes())
        except OSError as error:
            raise InputError(f"cannot read {wheel}: {error.strerror}") from error
        content.update("\n".join(self.requirements).encode())
        local = f"+{content.hexdigest()}" if self.wheels or self.beside else ""
        python = f"{sys.implementation.cache_tag}-{platform.machine()}"
        is_other = "numpy" in named_packages.names_of(self.beside)
        numpy = "" if is_other else f"-numpy{metadata.version('numpy')}"
        return f"{self.version}{local}-{python}{numpy}"

    @property
    def files(self) -> tuple[Path, ...]:
        return (*self.wheels, *self.own_wheels)

    @property
    def beside(self) -> tuple[str, ...]:
        return (*map(str, self.own_wheels), *self.requirements)

    @property
    def label(self) -> str:
        """What results call it: its version, or the packages that the user named."""
        return self.name if self.has_packages else self.version


def wheel_digest(key: str) -> str:
    """Return what the key of an install says of local wheels and named packages; empty without."""
    match = re.search(r"\+([0-9a-f]{8})-", key)
    return match[1] if match else ""


def is_release(text: str) -> bool:
    """Return whether an argument of the command line names a release rather than a model."""
    is_known = text in NAMES or _version(text) is not None
    return is_known or wheels.names_wheels(text) or named_packages.are_packages(text)


def parse_release(text: str) -> ReleaseSpec:
    """Return the release that an argument names; InputError, or MachineError without the index."""
    if text in (NEWEST, PREVIOUS):
        known = sorted((r.version for r in package_index.releases()), key=version_key)
        from_end = 1 if text == NEWEST else 2
        if len(known) < from_end:
            raise MachineError(
                f"the package index has no {text} release of mujoco: it lists"
                f" {count_of(len(known), 'release')} with an upload time"
            )
        return ReleaseSpec(known[-from_end], known[-from_end])
    if text == INSTALLED:
        installed = install_check.installed_version()
        if installed is None:
            raise InputError("no MuJoCo is installed in this environment")
        return ReleaseSpec(INSTALLED, installed)
    if named_packages.are_packages(text):
        return _with_packages(text)
    if wheels.names_wheels(text) or wheels.is_folder(text):
        files = wheels.find(text)
        version: str | None = str(files[0].version)
    else:
        files, version = [], _version(text)
    if version is None:
        meant = suggestion(text, NAMES)
        raise InputError(f"{one_line(repr(text), 100)} is not a release{meant}: give {FORMS}")
    if Version(version).release < OLDEST:
        oldest = ".".join(map(str, OLDEST))
        raise InputError(
            f"MuJoCo {version} is too old: {oldest} is the oldest that can be measured"
        )
    return ReleaseSpec(text, version, tuple(wheel.file.resolve() for wheel in files))


def _with_packages(text: str) -> ReleaseSpec:
    named = named_packages.parse(text)
    release = parse_release(named.release or INSTALLED)
    has_packages = bool(named.wheels or named.requirements)
    name = text if has_packages else release.name
    return ReleaseSpec(
        name, release.version, release.wheels, named.wheels, named.requirements, has_packages
    )


def _version(text: str) -> str | None:
    """Return a version in its normal form; None if `text` is none, or only a major version.

    `3.5` is 3.5.0, the first release of its minor version, as is `v3.5`; `3.5rc1` is 3.5.0rc1.
    """
    if len(text) > _LONGEST_VERSION:
        return None
    try:
        version = Version(text)
    except InvalidVersion:
        return None
    if len(version.release) == 1:
        return None
    normal = str(version)
    if len(version.release) == 2:
        major_minor = ".".join(map(str, version.release))
        normal = normal.replace(major_minor, f"{major_minor}.0", 1)
    return normal


def missing(versions: Iterable[str]) -> dict[str, str]:
    """Return the versions that are not there for this Python; a line for each names those near it.

    Raises:
      MachineError: the index cannot be read.
    """
    files_of = package_index.files()
    available = sorted(
        Version(version)
        for version, names in files_of.items()
        if any(wheel is not None and wheel.fits for wheel in map(wheels.wheel_of, map(Path, names)))
    )
    reasons = {}
    for version in versions:
        if Version(version) not in available:
            on_index = Version(version) in map(Version, files_of)
            where = "for this Python" if on_index else "on the package index"
            nearest = _nearest(version, available)
            reasons[version] = f"there is no MuJoCo {version} {where}{nearest}"
    return reasons


def _nearest(version: str, available: Sequence[Version]) -> str:
    final = [v for v in available if not v.is_prerelease and version_key(str(v)) >= OLDEST]
    if not final:
        return ""
    position = bisect.bisect(final, Version(version)) - _NEAREST // 2
    first = max(0, min(position, len(final) - _NEAREST))
    return f"; the nearest are {', '.join(map(str, final[first : first + _NEAREST]))}"
