"""Which files a model is compiled from, so that it can be compiled elsewhere."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import mujoco


def of(file: Path) -> tuple[str, ...]:
    """Return the paths of a model's files: its own first, then those that it names and that exist.

    An .mjb file names none. Releases without MjSpec or `mju_getXMLDependencies` (before 3.2.4) list
    less.

    Raises:
      Exception: the model cannot be read; MuJoCo raises several types.
    """
    if file.suffix.lower() == ".mjb":
        return (str(file),)
    named = [str(file), *_included(file), *_assets(file)]
    return tuple(dict.fromkeys(path for path in named if Path(path).is_file()))


def _included(file: Path) -> Iterator[str]:
    """Yield what the engine lists: included files, and most assets."""
    list_files = getattr(mujoco, "mju_getXMLDependencies", None)
    if list_files is not None:
        yield from map(str, list_files(str(file)))


def _assets(file: Path) -> Iterator[str]:
    """Yield assets, height fields from `meshdir`, as they are read (MuJoCo 3.14.0 and 4.0.0)."""
    if not hasattr(mujoco, "MjSpec"):
        return
    spec = mujoco.MjSpec.from_file(str(file))
    folders = {"meshes": spec.meshdir, "hfields": spec.meshdir, "skins": spec.meshdir}
    for kind, below in {**folders, "textures": spec.texturedir}.items():
        for asset in getattr(spec, kind, ()):
            for name in _names(asset):
                yield str(file.parent / below / name)


def _names(asset: Any) -> Iterator[str]:
    """Yield the files of an asset; a texture may have one for each side of a cube."""
    names = [getattr(asset, "file", ""), *getattr(asset, "cubefiles", ())]
    yield from (str(name) for name in names if name)
