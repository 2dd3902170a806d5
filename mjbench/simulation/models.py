"""Open any model by a name a person would type.

A model is named `cartpole` (one of ours, in models/), `path/to/robot.xml` or `.mjb` (a file), or
`gymnasium:ant` (an MJCF file inside an installed Python package, found without importing it).

`resolve` turns a name into a `ModelSource`, touching only the file system; `load` compiles it.
"""

import difflib
import importlib.util
import re
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mjbench.errors import InputError, one_line

if TYPE_CHECKING:
    from collections.abc import Iterable

# Where well-known packages keep the models that their names mean (searched first), and the
# package to install when it is missing.
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
    """Where a model comes from: the name it is told by, and the file that holds it."""

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
    """Return the source that `name` means.

    Raises:
      InputError: nothing of that name; the message lists what is near.
    """
    if name in shipped():
        return ModelSource(name, shipped_folder() / f"{name}.xml")
    path = Path(name).expanduser()
    if path.is_file():
        if path.suffix.lower() not in _SUFFIXES:
            raise InputError(f"{name}: a model file ends in .xml or .mjb")
        return ModelSource(name, path.resolve())
    package, colon, wanted = name.partition(":")
    if colon and re.fullmatch(r"[A-Za-z_][\w-]*", package):
        return ModelSource(name, _in_package(package.replace("-", "_"), wanted))
    if path.is_dir():
        raise InputError(f"{name} is a folder; name a model file in it")
    if path.suffix.lower() in _SUFFIXES or "/" in name:
        raise InputError(f"no such file: {name}")
    raise InputError(
        f"no model {name!r}{_near(name, shipped())}; ours are {', '.join(shipped())};"
        " or give a path to .xml or .mjb, or PACKAGE:NAME such as gymnasium:ant"
    )


def load(source: ModelSource) -> Any:
    """Compile the model of `source` and return its MjModel.

    Raises:
      InputError: MuJoCo refuses the file, or the model has no degree of freedom to step.
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


def _in_package(package: str, wanted: str) -> Path:
    """Return the model file `wanted` inside an installed package, which is not imported."""
    home, to_install = _HOMES.get(package, ("", package))
    try:
        spec = importlib.util.find_spec(package)
    except (ImportError, ValueError):
        spec = None
    folders = [Path(p) for p in (spec.submodule_search_locations or ())] if spec else []
    if not folders:
        raise InputError(
            f"package {package!r} is not installed here: python -m pip install {to_install}"
        )
    for root in folders:
        found = _search(root / home, wanted) or _search(root, wanted)
        if len(found) == 1:
            return found[0]
        if found:
            choices = ", ".join(_relative(p, root) for p in found[:8])
            raise InputError(f"{package}:{wanted} is ambiguous, name one of: {choices}")
    names = sorted({p.stem for root in folders for p in _model_files(root / home)})
    listing = f"; it has {', '.join(names[:40])}" if names else "; it ships no model file"
    raise InputError(f"{package} has no model {wanted!r}{_near(wanted, names)}{listing}")


def _search(folder: Path, wanted: str) -> list[Path]:
    """Return the model files below `folder` that `wanted` names, nearest to the folder first."""
    direct = folder / wanted
    if wanted and direct.suffix in _SUFFIXES and direct.is_file():
        return [direct]
    tail = Path(wanted).parts
    found = [
        path
        for path in _model_files(folder)
        if path.with_suffix("").parts[-len(tail) :] == tail or path.parts[-len(tail) :] == tail
    ]
    found.sort(key=lambda p: (len(p.parts), str(p)))
    # a file directly in the home folder wins over namesakes further down
    if found and found[0].parent == folder:
        return found[:1]
    return found


def _model_files(folder: Path) -> "Iterable[Path]":
    return (p for suffix in _SUFFIXES for p in folder.rglob(f"*{suffix}"))


def _relative(path: Path, root: Path) -> str:
    return path.relative_to(root).as_posix()


def _near(name: str, names: "Iterable[str]") -> str:
    close = difflib.get_close_matches(name, list(names), n=3)
    return f" (did you mean {', '.join(close)}?)" if close else ""
