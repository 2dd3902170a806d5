"""Releases of MuJoCo installed side by side, each alone in its own folder.

An install is a folder with one release, NumPy and their dependencies, and nothing else: the
`mujoco` package imports submodules from every other `mujoco` on the path. An install is built under
another name and renamed when complete, so a reader sees a whole install or none. A lock file for
each install stops two processes from building it at once, and from removing it while it is in use.
"""

import contextlib
import logging
import os
import shutil
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import platformdirs

from mjbench.errors import InputError, MachineError
from mjbench.host import platforms
from mjbench.releases import install_check, named_packages, pip, release_names
from mjbench.releases.release_names import INSTALLED, ReleaseSpec, parse_release

_LOG = logging.getLogger(__name__)
# Written last into an install; a folder without it is not one.
MARKER = "installed-by-mjbench"


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
    return named_packages.versions(folder)


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


def parse_available(names: Iterable[str]) -> list[ReleaseSpec]:
    """Return the releases with these names; InputError, or MachineError without the index.

    A version that neither the cache nor the index has is refused before any is installed.
    """
    releases = [parse_release(name) for name in names]
    check_available(releases)
    return releases


def check_available(releases: Iterable[ReleaseSpec]) -> None:
    """Refuse a version that would have to be installed, and that the package index does not have.

    Where the index does not answer, nothing is refused: what is installed can be measured.

    Raises:
      InputError: there is such a version.
    """
    to_install = [
        release.version
        for release in releases
        if release.name != INSTALLED
        and not release.wheels
        and not _is_complete(cache_folder() / release.key)
    ]
    if not to_install:
        return
    with contextlib.suppress(MachineError):
        for version, reason in release_names.missing(to_install).items():
            if not pip.is_available(version):
                raise InputError(reason)


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
