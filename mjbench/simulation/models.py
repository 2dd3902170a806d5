"""Find and load any model by a short name.

A name is `cartpole` (one of ours, in models/), `path/to/robot.xml` or `.mjb` (a file), or
`gymnasium:ant` (an MJCF file inside an installed Python package, found without importing it).

`resolve` turns a name into a `ModelSource` and reads only the file system; `load` compiles it.
"""

import importlib.util
import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from mjbench.errors import InputError, one_line, suggestion

if TYPE_CHECKING:
    import mujoco

# The folder in which well-known packages keep their models (searched first), and the name of the
# distribution to install.
_HOMES = {
    "gymnasium": ("envs/mujoco/assets", "gymnasium"),
    "dm_control": ("suite", "dm_control"),
    "gymnasium_robotics": ("envs/assets", "gymnasium-robotics"),
    "robosuite": ("models/assets", "robosuite"),
    "metaworld": ("assets", "metaworld"),
}
_SUFFIXES = (".xml", ".mjb")


@dataclass(frozen=True)
class ModelSource:
    """Where a model comes from.

    Attributes:
      name: as the user typed it.
      path: of the file.
    """

    name: str
    path: Path


def shipped_folder() -> Path:
    """Return the folder of our own models: beside the package, or inside an installed one."""
    package = Path(__file__).resolve().parents[1]
    installed = package / "_models"
    return installed if installed.is_dir() else package.parent / "models"


def shipped() -> list[str]:
    """Return the names of our own models, sorted."""
    return sorted(path.stem for path in shipped_folder().glob("*.xml"))


def resolve(name: str) -> ModelSource:
    """Return the source that `name` stands for.

    Raises:
      InputError: no such model; the message lists similar names.
    """
    if name in shipped():
        return ModelSource(name, shipped_folder() / f"{name}.xml")
    path = Path(name).expanduser()
    if path.is_file():
        if path.suffix.lower() not in _SUFFIXES:
            raise InputError(f"{name}: a model file ends in .xml or .mjb")
        return ModelSource(name, path.resolve())
    package, colon, model = name.partition(":")
    if colon and re.fullmatch(r"[A-Za-z_][\w-]*", package):
        return ModelSource(name, _in_package(package.replace("-", "_"), model))
    if path.is_dir():
        raise InputError(f"{name} is a folder; name a model file in it")
    if path.suffix.lower() in _SUFFIXES or "/" in name:
        raise InputError(f"no such file: {name}")
    raise InputError(
        f"no model {name!r}{suggestion(name, shipped())};"
        f" the shipped models are {', '.join(shipped())};"
        " or give a path to .xml or .mjb, or PACKAGE:NAME such as gymnasium:ant"
    )


def load(source: ModelSource) -> "mujoco.MjModel":
    """Return the compiled model of `source`.

    Raises:
      InputError: MuJoCo rejects the file, or the model has no degree of freedom to step.
    """
    import mujoco

    from_file = (
        mujoco.MjModel.from_binary_path
        if source.path.suffix.lower() == ".mjb"
        else mujoco.MjModel.from_xml_path
    )
    try:
        model = from_file(str(source.path))
    except Exception as error:  # MuJoCo raises ValueError, FatalError, and others by release
        raise InputError(f"{source.name}: MuJoCo cannot load it: {one_line(error)}") from error
    if model.nv == 0:
        raise InputError(f"{source.name}: nothing to step, the model has no degree of freedom")
    return model


def _in_package(package: str, name: str) -> Path:
    """Return the file of a model inside an installed package, which is not imported."""
    home, distribution = _HOMES.get(package, ("", package))
    try:
        spec = importlib.util.find_spec(package)
    except (ImportError, ValueError):
        spec = None
    folders = [Path(p) for p in (spec.submodule_search_locations or ())] if spec else []
    if not folders:
        raise InputError(
            f"package {package!r} is not installed here: python -m pip install {distribution}"
        )
    for root in folders:
        files = _search(root / home, name) or _search(root, name)
        if len(files) == 1:
            return files[0]
        if files:
            choices = ", ".join(_relative(p, root) for p in files[:8])
            raise InputError(f"{package}:{name} is ambiguous, name one of: {choices}")
    names = sorted({p.stem for root in folders for p in _model_files(root / home)})
    listing = f"; it has {', '.join(names[:40])}" if names else "; it ships no model file"
    raise InputError(f"{package} has no model {name!r}{suggestion(name, names)}{listing}")


def _search(folder: Path, name: str) -> list[Path]:
    """Return the model files below `folder` that `name` stands for, nearest to the folder first."""
    direct = folder / name
    if name and direct.suffix in _SUFFIXES and direct.is_file():
        return [direct]
    tail = Path(name).parts
    files = [
        path
        for path in _model_files(folder)
        if path.with_suffix("").parts[-len(tail) :] == tail or path.parts[-len(tail) :] == tail
    ]
    files.sort(key=lambda p: (len(p.parts), str(p)))
    # a file directly in the folder wins over files of the same name further down
    if files and files[0].parent == folder:
        return files[:1]
    return files


def _model_files(folder: Path) -> Iterable[Path]:
    return (p for suffix in _SUFFIXES for p in folder.rglob(f"*{suffix}"))


def _relative(path: Path, root: Path) -> str:
    return path.relative_to(root).as_posix()
