"""Releases of MuJoCo installed side by side, each alone in its own folder.

An install is a folder with one release, NumPy and their dependencies, and nothing else: the
`mujoco` package imports submodules from every other `mujoco` on the path. An install is built under
another name and renamed when complete, so a reader sees a whole install or none. A lock file for
each install stops two processes from building it at once, and from removing it while it is in use.
"""

import contextlib
import functools
import hashlib
import logging
import os
import platform
import re
import shutil
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path

import platformdirs
from packaging.version import InvalidVersion, Version

from mjbench.errors import InputError, MachineError, one_line, suggestion
from mjbench.host import platforms
from mjbench.releases import install_check, package_index, packages, pip, wheels
from mjbench.releases.release import OLDEST, version_key
from mjbench.units import count_of

_LOG = logging.getLogger(__name__)
# Names the release of the environment that mjbench runs in.
INSTALLED = "installed"
# Name the last release on the package index, and the one before it.
NEWEST, PREVIOUS = "newest", "previous"
# What a release can be, for messages.
FORMS = (
    f"a version such as 3.5.0, a wheel of mujoco, a folder of its wheels, `{INSTALLED}`,"
    f" `{NEWEST}` or `{PREVIOUS}`"
)
# No version has more characters; an install's name, of which it is part, must fit a file system.
_LONGEST_VERSION = 64
# Written last into an install; a folder without it is not one.
MARKER = "installed-by-mjbench"


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
        is_other = "numpy" in packages.names_of(self.beside)
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


# -- naming a release ---------------------------------------------------------------------------


def is_release(text: str) -> bool:
    """Return whether an argument of the command line names a release rather than a model."""
    is_known = text in (INSTALLED, NEWEST, PREVIOUS) or _version(text) is not None
    return is_known or wheels.names_wheels(text) or packages.are_packages(text)


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
    if packages.are_packages(text):
        return _with_packages(text)
    if wheels.names_wheels(text) or wheels.is_folder(text):
        files = wheels.find(text)
        version: str | None = str(files[0].version)
    else:
        files, version = [], _version(text)
    if version is None:
        meant = suggestion(text, [INSTALLED, NEWEST, PREVIOUS])
        raise InputError(f"{one_line(repr(text), 100)} is not a release{meant}: give {FORMS}")
    if Version(version).release < OLDEST:
        oldest = ".".join(map(str, OLDEST))
        raise InputError(
            f"MuJoCo {version} is too old: {oldest} is the oldest that can be measured"
        )
    return ReleaseSpec(text, version, tuple(wheel.file.resolve() for wheel in files))


def _with_packages(text: str) -> ReleaseSpec:
    named = packages.parse(text)
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


# -- installs -----------------------------------------------------------------------------------


def cache_folder() -> Path:
    try:
        folder = os.environ.get("MJBENCH_CACHE") or platformdirs.user_cache_path("mjbench")
        return Path(folder).expanduser().absolute()
    except RuntimeError as error:
        raise MachineError(
            "no home folder is known, in which releases would be installed;"
            " name another folder by the environment variable MJBENCH_CACHE"
        ) from error


def install_names() -> list[str]:
    folders = [marker.parent for marker in cache_folder().glob(f"*/{MARKER}")]
    return sorted(folder.name for folder in folders if not folder.name.startswith("."))


def matching(name: str) -> list[str]:
    """Return the installs of a version, or the one of this name; the name itself without any."""
    versions = f"{name}-", f"{name}+"
    return [each for each in install_names() if each == name or each.startswith(versions)] or [name]


def package_versions(release: ReleaseSpec) -> dict[str, str]:
    folder = None if release.name == INSTALLED else cache_folder() / release.key
    return packages.versions(folder)


@dataclass(frozen=True)
class InstallSize:
    """An install, and what it takes up."""

    name: str
    size_bytes: int
    unused_s: float

    @property
    def unused_days(self) -> float:
        return self.unused_s / 86_400


def install_sizes() -> list[InstallSize]:
    sizes = []
    for name in install_names():
        folder = cache_folder() / name
        with contextlib.suppress(OSError):  # it is being removed
            size_bytes = sum(f.stat().st_size for f in folder.rglob("*") if f.is_file())
            unused_s = time.time() - (folder / MARKER).stat().st_mtime
            sizes.append(InstallSize(name, size_bytes, unused_s))
    return sizes


def prune(days: int) -> Iterator[tuple[InstallSize, str]]:
    """Remove what was not used for so many days; yield each with why it is still there, or ""."""
    for install in install_sizes():
        if install.unused_days >= days:
            try:
                remove(install.name)
            except MachineError as error:  # it is in use
                yield install, str(error)
            else:
                yield install, ""


@contextlib.contextmanager
def use(release: ReleaseSpec) -> Iterator[Path | None]:
    """Yield the folder of a release's install, which is not removed while the block runs.

    The release is installed first if it is missing, and its files are checked. For `installed` the
    folder is None, and a changed file is logged: whoever built it may have meant to change it.
    """
    if release.name == INSTALLED:
        changed = install_check.changed_file()
        if changed:
            _LOG.warning("mjbench: %s since MuJoCo %s was installed here", changed, release.version)
        yield None
        return
    folder = cache_folder() / release.key
    while True:
        with locked(release.key, shared=True):
            if _is_complete(folder):
                _check_files(folder)
                with contextlib.suppress(OSError):  # a cache that may only be read
                    os.utime(folder / MARKER)  # when it was used last (see `install_sizes`)
                yield folder
                return
        _install(release, folder)


def install(release: ReleaseSpec) -> Path:
    """Install a release unless it is there; return its folder. InputError for `installed`."""
    with use(release) as folder:
        if folder is None:
            raise InputError(f"{INSTALLED} is the MuJoCo of this environment: name a version")
        return folder


def _install(release: ReleaseSpec, folder: Path) -> None:
    """Install a release, unless another process did meanwhile."""
    with locked(release.key):
        if _is_complete(folder):
            return
        partial = folder.with_name(f".{release.key}.partial")
        try:
            for remains in (partial, folder):  # of an install that was killed
                if remains.exists():
                    shutil.rmtree(remains)
            pip.install(release.version, release.wheels, partial, release.beside)
            (partial / MARKER).write_text(f"{release.version}\n")
            partial.rename(folder)
        except OSError as error:
            raise MachineError(f"cannot install into {cache_folder()}: {error.strerror}") from error
        finally:
            shutil.rmtree(partial, ignore_errors=True)


def remove(name: str) -> None:
    """Remove an install by its name; InputError without one, MachineError while it is in use."""
    names = install_names()
    if name not in names:
        raise InputError(f"no install {name!r}; there are {', '.join(names) or 'none'}")
    folder = cache_folder() / name
    with locked(name, wait=False):
        renamed = folder.with_name(f".{name}.removed")
        try:
            if renamed.exists():  # an earlier removal was killed
                shutil.rmtree(renamed)
            folder.rename(renamed)
            shutil.rmtree(renamed)
        except OSError as error:
            raise MachineError(f"cannot remove {folder}: {error.strerror}") from error


def _is_complete(folder: Path) -> bool:
    return (folder / MARKER).is_file()


def _check_files(folder: Path) -> None:
    if problem := install_check.damaged_file(folder):
        raise MachineError(
            f"the install {folder.name} is damaged: {problem};"
            f" remove it by `mjbench releases remove {folder.name}` and try again"
        )


@contextlib.contextmanager
def locked(name: str, shared: bool = False, wait: bool = True) -> Iterator[None]:
    """Hold the lock of an install while the block runs; the kernel frees it if the process dies.

    Processes that use the install share the lock; one that makes or removes it holds it alone. This
    is flock itself, because filelock's FileLock cannot be shared, and its ReadWriteLock waits where
    no signal ends the wait, and does not support NFS, where cache folders may lie.
    """
    file = cache_folder() / "locks" / name
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        descriptor = os.open(file, os.O_RDWR | os.O_CREAT, 0o644)
    except OSError as error:
        raise MachineError(
            f"cannot write {file.parent}: {error.strerror};"
            " name another folder by the environment variable MJBENCH_CACHE"
        ) from error
    try:
        try:
            platforms.lock_file(descriptor, shared=shared, wait=wait)
        except BlockingIOError:
            raise MachineError(f"{name} is in use by another process") from None
        except OSError as error:
            raise MachineError(f"cannot lock {file}: {error.strerror}") from error
        yield
    finally:
        os.close(descriptor)
