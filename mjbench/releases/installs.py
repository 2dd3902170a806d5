"""Releases of MuJoCo installed side by side, each alone in its own folder.

An install is a folder with one release, NumPy and their dependencies, and nothing else: the
`mujoco` package imports submodules from every other `mujoco` on the path. An install is built under
another name and renamed when complete, so a reader sees a whole install or none. A lock file for
each install stops two processes from building it at once, and from removing it while it is in use.
"""

import contextlib
import enum
import functools
import hashlib
import os
import platform
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path

import platformdirs
from packaging.utils import InvalidWheelFilename, parse_wheel_filename
from packaging.version import InvalidVersion, Version

from mjbench.errors import InputError, MachineError, one_line
from mjbench.instrument import platforms
from mjbench.releases import install_check

# Names the release of the environment that mjbench runs in.
INSTALLED = "installed"
# Written last into an install; a folder without it is not one.
_MARKER = "installed-by-mjbench"


@dataclass(frozen=True)
class ReleaseSpec:
    """A release that a user named.

    Attributes:
      name: as the user named it: a version, a wheel, a folder of wheels, or `installed`.
      version: the version that the release must report.
      wheels: the local wheels to install; empty for a version of the index.
    """

    name: str
    version: str
    wheels: tuple[Path, ...] = ()

    @functools.cached_property
    def key(self) -> str:
        """Return the name of its install: release, content of local wheels, Python and NumPy."""
        if self.name == INSTALLED:
            return f"{INSTALLED}-{self.version}"
        content = hashlib.blake2b(digest_size=4)
        for wheel in self.wheels:
            content.update(wheel.read_bytes())
        local = f"+{content.hexdigest()}" if self.wheels else ""
        python = f"{sys.implementation.cache_tag}-{platform.machine()}"
        return f"{self.version}{local}-{python}-numpy{metadata.version('numpy')}"


# -- naming a release ---------------------------------------------------------------------------


def is_release(text: str) -> bool:
    """Return whether an argument of the command line names a release rather than a model."""
    path = Path(text)
    return (
        text == INSTALLED
        or _version(text) is not None
        or path.suffix == ".whl"
        or (path.is_dir() and any(path.glob("mujoco-*.whl")))
    )


def parse_release(text: str) -> ReleaseSpec:
    """Return the release that an argument of the command line names; installs nothing.

    Raises:
      InputError: it names no release, or a wheel that does not exist.
    """
    if text == INSTALLED:
        installed = install_check.installed_version()
        if installed is None:
            raise InputError("no MuJoCo is installed in this environment")
        return ReleaseSpec(INSTALLED, installed)
    path = Path(text)
    if path.suffix == ".whl" or path.is_dir():
        return _parse_wheels(text)
    version = _version(text)
    if version is None:
        raise InputError(
            f"{text!r} is not a release: give a version such as 3.5.0, a wheel, or `{INSTALLED}`"
        )
    return ReleaseSpec(text, version)


def _version(text: str) -> str | None:
    """Return a version in its normal form; None if `text` is none, or only a major version.

    `3.5` is 3.5.0, the first release of its minor version, as is `v3.5`; `3.5rc1` is 3.5.0rc1.
    """
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


def _parse_wheels(text: str) -> ReleaseSpec:
    """Return the release of a wheel of `mujoco`, or of a folder with one."""
    path = Path(text)
    candidates = sorted(path.glob("mujoco-*.whl")) if path.is_dir() else [path]
    if len(candidates) > 1:
        raise InputError(f"{text} holds several releases: name one of its wheels")
    wheel = candidates[0] if candidates else path
    version = _wheel_version(wheel)
    if version is None or not wheel.is_file() or not wheel.name.startswith("mujoco-"):
        raise InputError(f"{text}: no such wheel of mujoco")
    # From 4.0.0 on a release is several wheels, and the C library is not in `mujoco`.
    others = [w for w in sorted(wheel.parent.glob("mujoco_*.whl")) if _wheel_version(w) == version]
    return ReleaseSpec(text, str(version), tuple(w.resolve() for w in (wheel, *others)))


def _wheel_version(wheel: Path) -> Version | None:
    """Return the version in a wheel's file name; None if it is not named as a wheel."""
    try:
        return parse_wheel_filename(wheel.name)[1]
    except InvalidWheelFilename:
        return None


# -- installs -----------------------------------------------------------------------------------


def cache_folder() -> Path:
    """Return the folder of all installs: $MJBENCH_CACHE, or one in the user's cache folder."""
    chosen = os.environ.get("MJBENCH_CACHE")
    return Path(chosen or platformdirs.user_cache_path("mjbench")).absolute()


def install_names() -> list[str]:
    """Return the names of the installs in the cache folder, sorted."""
    folders = [marker.parent for marker in cache_folder().glob(f"*/{_MARKER}")]
    return sorted(folder.name for folder in folders if not folder.name.startswith("."))


@contextlib.contextmanager
def use(release: ReleaseSpec) -> Iterator[Path | None]:
    """Yield the folder of a release's install, which is not removed while the block runs.

    The release is installed first if it is missing. For `installed` the folder is None.

    Raises:
      InputError: the index has no such release for this Python.
      MachineError: it cannot be installed.
    """
    if release.name == INSTALLED:
        yield None
        return
    folder = cache_folder() / release.key
    while True:
        with _locked(release.key, _Lock.SHARED):
            if _is_complete(folder):
                yield folder
                return
        install(release)


def install(release: ReleaseSpec) -> Path:
    """Install a release unless it is there; return its folder.

    Raises:
      InputError: the index has no such release for this Python.
      MachineError: it cannot be installed.
    """
    folder = cache_folder() / release.key
    with _locked(release.key, _Lock.EXCLUSIVE):
        if _is_complete(folder):
            return folder
        partial = folder.with_name(f".{release.key}.partial")
        try:
            for remains in (partial, folder):  # of an install that was killed
                if remains.exists():
                    shutil.rmtree(remains)
            _pip_install(release, partial)
            (partial / _MARKER).write_text(f"{release.version}\n")
            partial.rename(folder)
        except OSError as error:
            raise MachineError(f"cannot install into {cache_folder()}: {error.strerror}") from error
        finally:
            shutil.rmtree(partial, ignore_errors=True)
    return folder


def remove(name: str) -> None:
    """Remove an install by its name.

    Raises:
      InputError: there is no install of that name.
      MachineError: it is in use, or cannot be removed.
    """
    names = install_names()
    if name not in names:
        raise InputError(f"no install {name!r}; there are {', '.join(names) or 'none'}")
    folder = cache_folder() / name
    with _locked(name, _Lock.EXCLUSIVE_OR_FAIL):
        renamed = folder.with_name(f".{name}.removed")
        try:
            folder.rename(renamed)
            shutil.rmtree(renamed)
        except OSError as error:
            raise MachineError(f"cannot remove {folder}: {error.strerror}") from error


def _is_complete(folder: Path) -> bool:
    return (folder / _MARKER).is_file()


class _Lock(enum.Enum):
    """How an install is locked."""

    SHARED = "shared"
    """Held by every process that uses the install."""
    EXCLUSIVE = "exclusive"
    """Held by the process that makes it."""
    EXCLUSIVE_OR_FAIL = "exclusive or fail"
    """Held by the process that removes it; not waited for."""


@contextlib.contextmanager
def _locked(name: str, lock: _Lock) -> Iterator[None]:
    """Hold the lock of an install while the block runs; the kernel frees it if the process dies.

    This is flock itself, because filelock's FileLock cannot be shared, and its ReadWriteLock waits
    inside SQLite, where neither Ctrl-C nor SIGTERM ends the wait, and does not support NFS, where
    cache folders may lie.
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
            platforms.lock_file(
                descriptor,
                shared=lock is _Lock.SHARED,
                wait=lock is not _Lock.EXCLUSIVE_OR_FAIL,
            )
        except BlockingIOError:
            raise MachineError(f"{name} is in use by another process") from None
        yield
    finally:
        os.close(descriptor)


# -- pip ----------------------------------------------------------------------------------------


def _pip_install(release: ReleaseSpec, target: Path) -> None:
    """Install a release and this environment's NumPy version into a folder."""
    requirements = [str(wheel) for wheel in release.wheels] or [f"mujoco=={release.version}"]
    wheel_folders = {wheel.parent for wheel in release.wheels}
    command = [
        *(sys.executable, "-m", "pip", "install"),
        *("--quiet", "--disable-pip-version-check", "--no-input", "--only-binary=:all:"),
        f"--target={target}",
        *(f"--find-links={folder}" for folder in wheel_folders),
        *requirements,
        f"numpy=={metadata.version('numpy')}",
    ]
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
    if done.returncode != 0:
        raise _pip_error(release.version, done.stderr)


def _pip_error(version: str, stderr: str) -> InputError | MachineError:
    """Return the error that stands for what pip wrote."""
    lines = stderr.splitlines()
    errors = [line for line in lines if line.startswith("ERROR: ")]
    reason = one_line((errors or lines or ["pip failed"])[-1])
    offered = re.search(r"\(from versions: ([^)]*)\)", stderr)
    if "No matching distribution" in reason and offered and offered[1] != "none":
        newest = ", ".join(offered[1].split(", ")[-5:])
        return InputError(f"there is no MuJoCo {version} for this Python; the newest are {newest}")
    return MachineError(f"cannot install MuJoCo {version}: {reason}")
