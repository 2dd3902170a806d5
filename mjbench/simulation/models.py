"""Find and load any model by a short name.

A name is `cartpole` (one of ours, in models/), `path/to/robot.xml`, `.urdf` or `.mjb` (a file), or
`gymnasium:ant` (a model file inside an installed Python package, found without importing it).

`resolve` turns a name into a `ModelSource` and reads only the file system; `load` compiles it.
"""

import codecs
import contextlib
import errno
import importlib.util
import os
import re
import stat
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from mjbench.errors import InputError, MachineError, one_line, shown, suggestion, with_help

if TYPE_CHECKING:
    import mujoco

# The folder in which well-known packages keep their models (searched first), and the name of the
# distribution to install. Only these are recommended: another name may be a stranger's package.
_HOMES = {
    "gymnasium": ("envs/mujoco/assets", "gymnasium"),
    "dm_control": ("suite", "dm_control"),
    "gymnasium_robotics": ("envs/assets", "gymnasium-robotics"),
    "robosuite": ("models/assets", "robosuite"),
    "metaworld": ("assets", "metaworld"),
}
_COMPILED = ".mjb"
# Packages that are known to ship models.
MODEL_PACKAGES = tuple(_HOMES)
# What is wrong with an XML file in this encoding, and what to do.
UTF16 = "it is encoded in UTF-16, which MuJoCo does not read: save it as UTF-8"
# What a model file ends in. A package is searched for one group after the other, because many ship
# the same robot as MJCF and as URDF.
_SUFFIX_GROUPS = ((".xml", _COMPILED), (".urdf",))
SUFFIXES = tuple(suffix for group in _SUFFIX_GROUPS for suffix in group)
# What a model can be, beside a shipped one.
FORMS = "a path to .xml, .urdf or .mjb, or PACKAGE:NAME such as gymnasium:ant"

# Timesteps between the engine's mjMINVAL and mjMAXVAL, in seconds: time passes by no other.
MIN_TIMESTEP_S, MAX_TIMESTEP_S = 1e-15, 1e10


class UnknownModelError(InputError):
    """A name that is neither a shipped model, nor a path, nor PACKAGE:NAME."""


@dataclass(frozen=True)
class ModelSource:
    """Where a model comes from."""

    name: str
    path: Path


def shipped_folder() -> Path:
    package = Path(__file__).resolve().parents[1]
    installed = package / "_models"
    return installed if installed.is_dir() else package.parent / "models"


def shipped() -> list[str]:
    return sorted(path.stem for path in shipped_folder().glob("*.xml"))


def choices() -> str:
    """Return what a model can be, for messages."""
    return f"{', '.join(shipped())}, {FORMS}"


def check_any(given: Collection[object]) -> None:
    """Refuse a command line, or a call, without a model."""
    if not given:
        raise InputError(f"name a model, one of {choices()}")


def resolve_all(names: Sequence[str]) -> list[ModelSource]:
    check_any(names)
    return [resolve(name) for name in names]


def resolve(name: str) -> ModelSource:
    """Return the source that `name` stands for; of a link, as MuJoCo finds meshes beside it."""
    if name in shipped():
        return ModelSource(name, shipped_folder() / f"{name}.xml")
    path = _expanded(name)
    status = _status(name, path)
    if status is not None and name.strip():
        _check_file(name, path, status)
        return ModelSource(name, path.absolute())
    if re.match(r"[A-Za-z][A-Za-z0-9+.-]*://", name):
        raise InputError(
            f"{shown(name)} is an address: download the model with its meshes, and give its path"
        )
    package = re.fullmatch(r"([A-Za-z_][\w.-]+):(.*)", name, flags=re.DOTALL)
    if package:
        file = _in_package(package[1].replace("-", "_"), package[2])
        _check_file(name, file, file.stat())
        return ModelSource(name, file)
    raise _missing_error(name, path)


def load(source: ModelSource) -> "mujoco.MjModel":
    """Return the compiled model; InputError for one that MuJoCo rejects, or that cannot step."""
    import mujoco

    compiled = source.path.suffix.lower() == _COMPILED
    from_file = mujoco.MjModel.from_binary_path if compiled else mujoco.MjModel.from_xml_path
    try:
        model = from_file(str(source.path))
    except Exception as error:  # MuJoCo raises ValueError, FatalError, and others by release
        reason = with_help(one_line(error))
        raise InputError(
            f"{source.name}: MuJoCo cannot load it: {reason}{_advice(source.path, reason)}"
        ) from error
    if model.nv == 0:
        raise InputError(f"{source.name}: nothing to step, the model has no degree of freedom")
    timestep_s = float(model.opt.timestep)
    if not MIN_TIMESTEP_S <= timestep_s <= MAX_TIMESTEP_S:
        raise InputError(
            f"{source.name}: its timestep is {timestep_s:g} s; it must be above 0 and finite"
        )
    return model


def _advice(file: Path, reason: str) -> str:
    import mujoco

    if file.suffix.lower() == _COMPILED:
        release = mujoco.__version__
        return (
            f"; only the release that saved an .mjb file can load it, and this is MuJoCo {release}"
        )
    if "'package:" in reason:
        return (
            "; MuJoCo finds no packages of ROS: put the meshes beside the URDF, and name them there"
            " by the file alone, such as base.stl"
        )
    with contextlib.suppress(OSError), file.open("rb") as stream:
        if stream.read(4).startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE, b"<\0", b"\0<")):
            return f"; {UTF16}"
    return ""


def save(model: "mujoco.MjModel", file: Path) -> None:
    """Save a compiled model; MachineError where the disk is full, which MuJoCo does not report."""
    import mujoco

    mujoco.mj_saveModel(model, str(file), None)
    if not file.exists() or file.stat().st_size < mujoco.mj_sizeModel(model):
        raise MachineError(f"cannot write {file}: is the disk full?")


# -- paths --------------------------------------------------------------------------------------


def _expanded(name: str) -> Path:
    try:
        return Path(name).expanduser()
    except (RuntimeError, ValueError):  # no such user, or a NUL
        return Path(name)


def _status(name: str, path: Path) -> os.stat_result | None:
    try:
        return path.stat()
    except (FileNotFoundError, NotADirectoryError, ValueError):  # ValueError: NUL, or a surrogate
        return None
    except OSError as error:
        if error.errno == errno.ENAMETOOLONG:
            return None
        raise InputError(f"cannot read {shown(name)}: {error.strerror}") from error


def _check_file(name: str, path: Path, status: os.stat_result) -> None:
    label = shown(name)
    if stat.S_ISDIR(status.st_mode):
        raise InputError(f"{label} is a folder; name a model file in it")
    if not stat.S_ISREG(status.st_mode):
        raise InputError(f"{label} is not a regular file; write the model to one")
    if path.suffix.lower() not in SUFFIXES:
        runs = f"; `mjbench run {label}` runs a program" if path.suffix == ".py" else ""
        raise InputError(f"{label}: a model file ends in .xml, .urdf or .mjb{runs}")
    if status.st_size == 0:
        raise InputError(f"{label} is empty")
    try:
        with path.open("rb"):
            pass
    except OSError as error:
        raise InputError(f"cannot read {label}: {error.strerror}") from error


def _missing_error(name: str, path: Path) -> InputError:
    label = shown(name)
    try:
        target = path.readlink()
    except (OSError, ValueError):
        pass
    else:
        return InputError(f"{label} is a link to {shown(str(target))}, which does not exist")
    if name.startswith("~") and path == Path(name):
        return InputError(f"no such file: {label} (no home folder {shown(path.parts[0])} is known)")
    if "\\" in name:
        return InputError(f"no such file: {label} (here / separates folders, not \\)")
    drive = re.match(r"[A-Za-z]:", name)
    if drive or "/" in name or path.suffix.lower() in SUFFIXES:
        return InputError(f"no such file: {label}")
    return UnknownModelError(
        f"no model {one_line(repr(name), 100)}{suggestion(name, shipped())};"
        f" give one of {choices()}"
    )


# -- models of packages -------------------------------------------------------------------------


def _in_package(package: str, name: str) -> Path:
    parts = Path(name).parts
    package, *below = package.split(".")
    home, _ = _HOMES.get(package, ("", ""))
    folders = _package_folders(package)
    if below:
        model = "/".join([*below, name])
        raise InputError(f"name a model of {package} by its folder: {package}:{shown(model)}")
    if ".." in parts or Path(name).is_absolute():
        raise InputError(f"{package}:{shown(name)}: NAME must be a file inside the package")
    for root in folders:
        files = _search(root / home, parts) or _search(root, parts)
        if len(files) == 1:
            return files[0]
        if files:
            choices = ", ".join(p.relative_to(root).as_posix() for p in files[:8])
            raise InputError(f"{package}:{shown(name)} is ambiguous, name one of: {choices}")
    names = sorted({p.stem for root in folders for p in _model_files(root / home, SUFFIXES)})
    listing = f"; it has {', '.join(names[:40])}" if names else "; it ships no model file"
    raise InputError(
        f"{package} has no model {one_line(repr(name), 100)}{suggestion(name, names)}{listing}"
    )


def _package_folders(package: str) -> list[Path]:
    try:
        spec = importlib.util.find_spec(package)  # imports nothing, as the name has no dot
    except (ImportError, ValueError, AttributeError):
        spec = None
    if spec is not None:
        folders = [Path(p) for p in spec.submodule_search_locations or ()]
        if not folders:
            raise InputError(f"{shown(package)} is a module without a folder, it ships no model")
        return folders
    if package in _HOMES:
        _, distribution = _HOMES[package]
        raise InputError(
            f"package {package!r} is not installed here: python -m pip install {distribution}"
        )
    raise InputError(
        f"no package {one_line(repr(package), 100)} is installed here{suggestion(package, _HOMES)}"
    )


def _search(folder: Path, tail: Sequence[str]) -> list[Path]:
    """Return the model files below `folder` that a name stands for, nearest to the folder first.

    The folder may hold symbolic links to elsewhere, as some installers create them. `tail` has the
    parts of the name, with or without a suffix.
    """
    if not tail:
        return []
    direct = folder.joinpath(*tail)
    if direct.suffix in SUFFIXES and is_file(direct):
        return [direct]
    for suffixes in _SUFFIX_GROUPS:
        files = [
            path
            for path in _model_files(folder, suffixes)
            if tuple(tail) in (path.with_suffix("").parts[-len(tail) :], path.parts[-len(tail) :])
        ]
        files.sort(key=lambda p: (len(p.parts), str(p)))
        # a file directly in the folder wins over files of the same name further down
        if files and files[0].parent == folder:
            return files[:1]
        if files:
            return files
    return []


def _model_files(folder: Path, suffixes: Sequence[str]) -> Iterable[Path]:
    return (p for suffix in suffixes for p in folder.rglob(f"*{suffix}") if is_file(p))


def is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except OSError:  # its name is too long, or a folder above it is closed to us
        return False
