"""Which revisions of the user's code have to be built, and their wheels, in the cache folder.

A wheel is never editable, and it is built once for a tree, a Python and a machine. It is installed
beside the MuJoCo of this environment, as a release is. Both are removed as installs of releases
are (see `installs.remove`).
"""

import contextlib
import os
import platform
import re
import shutil
import sys
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from mjbench.errors import MachineError, reason
from mjbench.releases import installs, pip, release_names
from mjbench.releases.pip import BuildError
from mjbench.releases.release_names import ReleaseSpec
from mjbench.releases.revisions import Revision

# Build backends that compile, and what other builds say where they do.
_COMPILING = ("maturin", "mesonpy", "py_build_cmake", "scikit_build_core", "skbuild")
_EXTENSION = re.compile(r"ext_modules|ext-modules|Extension\(|cythonize|rust_extensions")
# Files that pin what a project is developed with.
_LOCKS = ("requirements*.txt", "constraints*.txt", "uv.lock", "poetry.lock", "pdm.lock")
# Folders that hold no importable code of a project.
_SKIPPED = frozenset({"node_modules", "build", "dist", "__pycache__"})
# Packages lie no deeper than this many folders.
_DEPTH = 3


def built(revision: Revision, source: Path, tree: str) -> ReleaseSpec:
    """Return the MuJoCo of this environment with a revision beside it; nothing is installed yet."""
    version = release_names.parse_release(release_names.INSTALLED).version
    wheel = _wheel(revision, source, tree)
    # not the name alone: a branch may be called `installed`
    return ReleaseSpec(f"rev={revision.name}", version, own_wheels=(wheel,))


def _wheel(revision: Revision, source: Path, tree: str) -> Path:
    name = f"wheel-{tree}-{sys.implementation.cache_tag}-{platform.machine()}"
    folder = installs.cache_folder() / name
    with installs.locked(name):
        partial = folder.with_name(f".{name}.partial")
        try:
            if not folder.exists():
                shutil.rmtree(partial, ignore_errors=True)
                partial.mkdir(parents=True)
                pip.build(str(revision), source, partial)
                (partial / installs.MARKER).write_text(f"{revision}\n")
                partial.rename(folder)
            with contextlib.suppress(OSError):  # a cache that may only be read
                os.utime(folder / installs.MARKER)  # when it was used last
            (wheel,) = folder.glob("*.whl")
        except BuildError as error:
            raise BuildError(f"cannot build {revision}: {error}") from error
        except OSError as error:
            raise MachineError(f"cannot write {folder}: {error.strerror}") from error
        except ValueError as error:
            raise BuildError(f"{revision} does not build to one wheel") from error
        finally:
            shutil.rmtree(partial, ignore_errors=True)
    return wheel


def source_folders(tree: Path) -> list[Path]:
    """Return the folders that the modules of a source tree are imported from, the first one first.

    These are `src`, where it exists, those of `pythonpath` in the settings of pytest, and the top.
    """
    settings = _table(_pyproject(tree), "tool", "pytest", "ini_options").get("pythonpath", ())
    named = [settings] if isinstance(settings, str) else list(settings)
    folders = [tree / name for name in ("src", *map(str, named), ".")]
    return list(dict.fromkeys(folder.resolve() for folder in folders if folder.is_dir()))


def package_names(tree: Path) -> frozenset[str]:
    """Return the packages of a source tree, each with `__init__.py`, and the modules beside."""
    names = set[str]()
    for folder, subfolders, files in os.walk(tree):
        path = Path(folder)
        level = len(path.relative_to(tree).parts)
        is_package = "__init__.py" in files and level > 0
        if is_package:
            names.add(path.name)
        elif path in (tree, tree / "src"):
            names |= {name.removesuffix(".py") for name in files if name.endswith(".py")}
        searched = [name for name in subfolders if name[0] != "." and name not in _SKIPPED]
        subfolders[:] = [] if is_package or level >= _DEPTH else searched
    return frozenset(names)


def has_module(tree: Path, name: str) -> bool:
    files = (f"{name}.py", f"{name}/__init__.py")
    return any((folder / file).is_file() for folder in source_folders(tree) for file in files)


def is_compiled(tree: Path) -> bool:
    """Return whether a source tree is a package with extension modules, which have to be built."""
    backend = str(_table(_pyproject(tree), "build-system").get("build-backend", ""))
    if backend.partition(".")[0] in _COMPILING:
        return True
    files = [tree / "setup.py", tree / "setup.cfg", tree / "pyproject.toml"]
    return any(_EXTENSION.search(f.read_text(errors="replace")) for f in files if f.is_file())


def dependencies(tree: Path) -> str:
    """Return a text that is the same for trees whose packages need the same."""
    project = _table(_pyproject(tree), "project")
    return repr([project.get(key) for key in ("requires-python", "dependencies")])


def lock_files(tree: Path) -> dict[str, bytes]:
    files = (file for pattern in _LOCKS for file in tree.glob(pattern))
    return {file.name: file.read_bytes() for file in files if file.is_file()}


def is_installable(tree: Path) -> bool:
    return (tree / "pyproject.toml").exists() or (tree / "setup.py").exists()


def _pyproject(tree: Path) -> Mapping[str, Any]:
    file = tree / "pyproject.toml"
    try:
        return tomllib.loads(file.read_text(encoding="utf-8"))
    except FileNotFoundError:
        return {}
    except (OSError, ValueError) as error:
        raise MachineError(f"cannot read pyproject.toml: {reason(error)}") from error


def _table(settings: Mapping[str, Any], *names: str) -> Mapping[str, Any]:
    for name in names:
        inner = settings.get(name)
        settings = inner if isinstance(inner, dict) else {}
    return settings
