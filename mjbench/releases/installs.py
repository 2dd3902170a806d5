"""Releases of MuJoCo installed side by side, each alone in a folder of its own.

An install is a folder that holds one release, NumPy, and what they need, and nothing else: the
`mujoco` package borrows submodules from every other `mujoco` it finds on the path. It is made
beside the cache, checked, and moved into place in one step, so that a reader finds a whole one or
none; a lock for each keeps two makers apart, and whoever uses one holds that lock with others.
"""

import contextlib
import fcntl
import functools
import hashlib
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path

from mjbench.errors import InputError, MachineError, one_line
from mjbench.releases import install_check

# The release of the environment that mjbench runs in.
INSTALLED = "installed"


@dataclass(frozen=True)
class ReleaseSpec:
    """A release that a user named.

    Attributes:
      word: as it was named: a version, a wheel, a folder of wheels, or `installed`.
      version: what it must say it is.
      wheels: the local wheels to install; empty for a version of the index.
    """

    word: str
    version: str
    wheels: tuple[Path, ...] = ()

    @functools.cached_property
    def key(self) -> str:
        """Return the name of its folder: release, content of local wheels, Python and NumPy."""
        if self.word == INSTALLED:
            return f"{INSTALLED}-{self.version}"
        content = hashlib.blake2b(digest_size=4)
        for wheel in self.wheels:
            content.update(wheel.read_bytes())
        local = f"+{content.hexdigest()}" if self.wheels else ""
        python = f"{sys.implementation.cache_tag}-{os.uname().machine}"
        return f"{self.version}{local}-{python}-numpy{metadata.version('numpy')}"


def is_release(word: str) -> bool:
    """Return whether a word of the command line names a release rather than a model."""
    path = Path(word)
    return (
        word == INSTALLED
        or bool(re.fullmatch(r"v?\d+\.\d+(\.\d+)*((a|b|rc|\.?dev|\.?post)\d+)*", word))
        or path.suffix == ".whl"
        or (path.is_dir() and any(path.glob("mujoco-*.whl")))
    )


def parse_release(word: str) -> ReleaseSpec:
    """Return the release that a word names; installs nothing.

    Raises:
      InputError: no such file, or not a release.
    """
    if word == INSTALLED:
        version = install_check.installed()
        if version is None:
            raise InputError("no MuJoCo is installed here")
        return ReleaseSpec(INSTALLED, version)
    path = Path(word)
    if path.suffix == ".whl" or path.is_dir():
        main = sorted(path.glob("mujoco-*.whl")) if path.is_dir() else [path]
        if not main or not main[0].is_file() or not main[0].name.startswith("mujoco-"):
            raise InputError(f"{word}: no such wheel of mujoco")
        if len(main) > 1:
            raise InputError(f"{word} holds several releases: name one of its wheels")
        version = main[0].name.split("-")[1]
        # from 4.0.0 on a release is several wheels, and the library is not in the first
        wheels = [*main, *sorted(main[0].parent.glob(f"mujoco_*-{version}-*.whl"))]
        return ReleaseSpec(word, version, tuple(w.resolve() for w in wheels))
    if not is_release(word):
        raise InputError(
            f"{word!r} is no release: give a version such as 3.5.0, a wheel, or `{INSTALLED}`"
        )
    version = word.removeprefix("v")
    return ReleaseSpec(word, f"{version}.0" if re.fullmatch(r"\d+\.\d+", version) else version)


def cache() -> Path:
    """Return the folder of all installs: $MJBENCH_CACHE, or one in the user's cache folder."""
    named = os.environ.get("MJBENCH_CACHE")
    if named:
        return Path(named).absolute()
    base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(base).absolute() / "mjbench"


def installed() -> list[str]:
    """Return the names of the installs there are, sorted."""
    found = cache().glob("*/installed-by-mjbench")
    return sorted(p.parent.name for p in found if not p.parent.name.startswith("."))


@contextlib.contextmanager
def use(release: ReleaseSpec) -> Iterator[Path | None]:
    """Yield the folder of a release's install, which stays while the block runs.

    It is made first if it is missing. For `installed` it is None.

    Raises:
      InputError: the index has no such release for this Python.
      MachineError: it cannot be installed.
    """
    if release.word == INSTALLED:
        yield None
        return
    folder = cache() / release.key
    while True:
        with _lock(release.key, fcntl.LOCK_SH):
            if _whole(folder):
                yield folder
                return
        install(release)


def install(release: ReleaseSpec) -> Path:
    """Install a release unless it is there; return its folder.

    Raises:
      InputError: the index has no such release for this Python.
      MachineError: it cannot be installed.
    """
    folder = cache() / release.key
    with _lock(release.key, fcntl.LOCK_EX):
        if _whole(folder):
            return folder
        partial = folder.with_name(f".{release.key}.partial")
        try:
            for left in (partial, folder):
                if left.exists():
                    shutil.rmtree(left)
            _pip(release, partial)
            (partial / "installed-by-mjbench").write_text(f"{release.version}\n")
            partial.rename(folder)
        except OSError as error:
            raise MachineError(f"cannot install into {cache()}: {error.strerror}") from error
        finally:
            shutil.rmtree(partial, ignore_errors=True)
    return folder


def remove(name: str) -> None:
    """Remove an install by its name.

    Raises:
      InputError: there is none of that name.
      MachineError: it is in use, or cannot be removed.
    """
    if name not in installed():
        raise InputError(f"no install {name!r}; there are {', '.join(installed()) or 'none'}")
    folder = cache() / name
    with _lock(name, fcntl.LOCK_EX | fcntl.LOCK_NB):
        gone = folder.with_name(f".{name}.removed")
        try:
            folder.rename(gone)
            shutil.rmtree(gone)
        except OSError as error:
            raise MachineError(f"cannot remove {folder}: {error.strerror}") from error


def _whole(folder: Path) -> bool:
    return (folder / "installed-by-mjbench").is_file()


@contextlib.contextmanager
def _lock(name: str, kind: int) -> Iterator[None]:
    file = cache() / "locks" / name
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        descriptor = os.open(file, os.O_RDWR | os.O_CREAT, 0o644)
    except OSError as error:
        raise MachineError(
            f"cannot write {file.parent}: {error.strerror}; name another folder by MJBENCH_CACHE"
        ) from error
    try:
        fcntl.flock(descriptor, kind)
        yield
    except BlockingIOError:
        raise MachineError(f"{name} is in use by another process") from None
    finally:
        os.close(descriptor)


def _pip(release: ReleaseSpec, target: Path) -> None:
    """Install a release and this environment's NumPy version into a folder."""
    what = [str(w) for w in release.wheels] or [f"mujoco=={release.version}"]
    near = [f"--find-links={folder}" for folder in {w.parent for w in release.wheels}]
    command = [sys.executable, "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    command += ["--only-binary=:all:", "--no-input", f"--target={target}", *near]
    command += [*what, f"numpy=={metadata.version('numpy')}"]
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
    if done.returncode == 0:
        return
    said = [line for line in done.stderr.splitlines() if line.startswith("ERROR: ")]
    last = one_line((said or done.stderr.splitlines() or ["pip failed"])[-1])
    offered = re.search(r"\(from versions: ([^)]*)\)", done.stderr)
    if "No matching distribution" in last and offered and offered[1] != "none":
        newest = ", ".join(offered[1].split(", ")[-5:])
        raise InputError(
            f"there is no MuJoCo {release.version} for this Python; the newest are {newest}"
        )
    raise MachineError(f"MuJoCo {release.version} cannot be installed: {last}")
