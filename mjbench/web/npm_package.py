"""Where MuJoCo's npm package is: the WebAssembly builds of one release, installed by npm.

    npm install --no-package-lock --prefix CACHE/npm/3.14.0 @mujoco/mujoco@3.14.0

puts it where `find` looks, a folder for each release. mjbench downloads nothing itself:
a package that is missing is an error with this command.
"""

import json
import shlex
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Any

from mjbench.errors import InputError, MachineError, one_line, shown
from mjbench.releases import installs, release_names
from mjbench.releases.release import version_key

# Its name on the registry of npm.
NAME = "@mujoco/mujoco"
# Where npm puts its manifest below a folder.
_MANIFEST = Path("node_modules", NAME, "package.json")
# Pins the release that is measured unless the user names another.
_PIN = Path(__file__).with_name("package.json")


class Build(StrEnum):
    """A build of the engine in the package, which is also the name of a path."""

    WASM = "wasm"
    """The single-threaded build, `@mujoco/mujoco`."""
    WASM_MT = "wasm_mt"
    """The build with threads, `@mujoco/mujoco/mt`."""


@dataclass(frozen=True)
class NpmPackage:
    """The installed package of one release.

    Attributes:
      folder: of the package, with `package.json`, `mujoco.js`, `mujoco.wasm` and `mt`.
    """

    folder: Path
    version: str

    def script(self, build: Build) -> Path:
        return self.folder / ("mt" if build is Build.WASM_MT else "") / "mujoco.js"


def pinned_version() -> str:
    return str(json.loads(_PIN.read_text(encoding="utf-8"))["dependencies"][NAME])


def cache_folder() -> Path:
    return installs.cache_folder() / "npm"


def install_command(version: str) -> str:
    prefix = shlex.quote(str(cache_folder() / version))
    return f"npm install --no-package-lock --prefix {prefix} {NAME}@{version}"


def installed_versions() -> list[str]:
    names = [file.parents[3].name for file in cache_folder().glob(f"*/{_MANIFEST.as_posix()}")]
    return sorted((name for name in names if release_names.is_release(name)), key=version_key)


def find(version: str | None = None, folder: Path | None = None) -> NpmPackage:
    """Return an installed package, all of whose files are there.

    Args:
      version: of the release; None for the pinned one, or for whichever `folder` has.
      folder: into which npm installed it, or the package itself; None for the cache folder.
    """
    if folder is not None:
        package = _in_folder(folder)
        if version is not None and package.version != version:
            raise InputError(
                f"{shown(str(folder))} has {NAME} {package.version}, not {version}:"
                f" {install_command(version)}"
            )
        return package
    wanted = version or pinned_version()
    manifest = cache_folder() / wanted / _MANIFEST
    if not manifest.is_file():
        others = [name for name in installed_versions() if name != wanted]
        hint = f" (installed: {', '.join(others)})" if others else ""
        raise MachineError(f"{NAME} {wanted} is not installed{hint}: {install_command(wanted)}")
    package = _read(manifest)
    if package.version != wanted:
        raise MachineError(
            f"{manifest.parent} has {NAME} {package.version}, not {wanted}:"
            f" {install_command(wanted)}"
        )
    return package


def _in_folder(folder: Path) -> NpmPackage:
    for below in (_MANIFEST, Path(NAME, "package.json"), Path("package.json")):
        manifest = folder / below
        if manifest.is_file() and _manifest(manifest).get("name") == NAME:
            return _read(manifest)
    raise InputError(
        f"{shown(str(folder))} has no package {NAME}:"
        f" npm install --prefix {shlex.quote(str(folder))} {NAME}@{pinned_version()}"
    )


def _read(manifest: Path) -> NpmPackage:
    version = _manifest(manifest).get("version")
    package = NpmPackage(manifest.parent.resolve(), str(version))
    if not release_names.is_release(package.version):
        raise MachineError(f"{manifest} names no version; install the package anew")
    for build in Build:
        for file in (package.script(build), package.script(build).with_suffix(".wasm")):
            if not file.is_file() or not file.stat().st_size:
                raise MachineError(
                    f"{file} is missing or empty; remove {package.folder}, then:"
                    f" {install_command(package.version)}"
                )
    return package


def _manifest(file: Path) -> Mapping[str, Any]:
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise MachineError(f"cannot read {file}: {one_line(error)}") from error
    if not isinstance(content, dict):
        raise MachineError(f"{file} is not the manifest of a package")
    return content
