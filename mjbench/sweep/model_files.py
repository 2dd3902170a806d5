"""The user's models as files that travel to other machines: each with all that it refers to.

Which files those are, MuJoCo knows; a release that cannot say it, or a model that is no MJCF, takes
its whole folder along. A copy is loaded before anything is measured: what lacks a file fails here.
"""

import hashlib
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from mjbench.errors import InputError, MachineError, printable, shown, writing
from mjbench.host import isolate
from mjbench.host.isolate import Channel
from mjbench.limits import TIME_LIMIT_S
from mjbench.simulation import models
from mjbench.simulation.models import ModelSource

# The most that a model and all of its files may take, in bytes, and how many files there may be.
MAX_BYTES, _MAX_FILES = 1 << 29, 10_000
_INDEX = "models.json"


@dataclass(frozen=True)
class CarriedModel:
    """A model with all of its files, by their paths below one folder; `main` is its own."""

    name: str
    main: str
    files: Mapping[str, bytes]
    digest: str


def content_digest(source: ModelSource) -> str:
    return hashlib.sha256(_content(source.name, source.path)).hexdigest()


def is_shipped(source: ModelSource) -> bool:
    return source.path.parent == models.shipped_folder()


def carry(source: ModelSource, limit_s: float = TIME_LIMIT_S) -> CarriedModel:
    # without `..`, as the files that it refers to are listed
    source = ModelSource(source.name, Path(os.path.normpath(source.path.absolute())))
    paths = isolate.call(list_files, source, limit_s=limit_s)
    root = _root(source.name, paths)
    main, files = _relative(source.path, root), _contents(source.name, paths, root)
    return CarriedModel(source.name, main, files, _digest(main, files))


def unpack(carried: Sequence[CarriedModel], folder: Path) -> Path:
    """Write models into a folder; return the list of them, for `models`."""
    paths: dict[str, Path] = {}
    with writing(folder):
        for number, model in enumerate(carried):
            if _digest(model.main, model.files) != model.digest:
                raise MachineError(f"{model.name}: its files were damaged on their way")
            paths[model.name] = _write(model.files, folder / str(number)) / model.main
        index = folder / _INDEX
        models.write_carried(index, paths)
    return index


# -- in a child ----------------------------------------------------------------------------------


def list_files(source: ModelSource, channel: Channel) -> list[Path]:
    """Return the files that a model refers to, absolute; runs in an empty folder."""
    channel.doing(f"loading {source.name}")
    models.load(source)
    named = _dependencies(source.path)
    files = sorted({source.path, *(_all_below(source) if named is None else named)})
    root = _root(source.name, files)
    copy = _write(_contents(source.name, files, root), Path.cwd() / "copy")
    channel.doing(f"loading a copy of {source.name}")
    main = copy / _relative(source.path, root)
    try:
        models.load(ModelSource(source.name, main))
    except InputError as error:
        raise InputError(
            f"{error}; that is a copy with {len(files)} files: keep what the model refers to"
            " below one folder, by relative paths"
        ) from None
    outside = [path for path in _dependencies(main) or () if not path.is_relative_to(copy)]
    if outside:
        raise InputError(
            f"{source.name} refers to {shown(str(outside[0]))} by an absolute path, which other"
            " machines do not have"
        )
    return files


def _dependencies(file: Path) -> list[Path] | None:
    import mujoco

    if not hasattr(mujoco, "mju_getXMLDependencies") or file.suffix.lower() != ".xml":
        return None
    try:
        names = models.files_of(file)
    except Exception:  # which exception it is differs by release
        return None
    return [Path(os.path.normpath(name)) for name in names]


def _all_below(source: ModelSource) -> Iterator[Path]:
    if source.path.suffix.lower() == ".mjb":
        yield source.path
        return
    count = 0
    for path in source.path.parent.rglob("*"):
        if path.is_file():
            count += 1
            yield path
        if count > _MAX_FILES:
            raise InputError(
                f"{source.name}: its folder has more than {_MAX_FILES} files, all of which would"
                " travel; put it into a folder of its own, with what it refers to"
            )


# -- files ---------------------------------------------------------------------------------------


def _root(name: str, files: Sequence[Path]) -> Path:
    """Return the folder that holds all files; refuse too large ones."""
    try:
        size_bytes = sum(file.stat().st_size for file in files)
    except OSError as error:
        raise InputError(f"{name}: cannot read {error.filename}: {error.strerror}") from error
    if size_bytes > MAX_BYTES:
        raise InputError(
            f"{name} and the files that it refers to take {size_bytes / 2**20:.0f} MiB, more than"
            f" the {MAX_BYTES / 2**20:.0f} MiB that are sent to nodes"
        )
    return Path(os.path.commonpath([file.parent for file in files]))


def _relative(path: Path, root: Path) -> str:
    return path.relative_to(root).as_posix()


def _contents(name: str, files: Sequence[Path], root: Path) -> dict[str, bytes]:
    return {_relative(file, root): _content(name, file) for file in files}


def _content(name: str, path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise InputError(f"{name}: cannot read {printable(path)}: {error.strerror}") from error


def _digest(main: str, files: Mapping[str, bytes]) -> str:
    digest = hashlib.sha256(main.encode())
    for path, content in sorted(files.items()):
        digest.update(f"\0{path}\0".encode())
        digest.update(hashlib.sha256(content).digest())
    return digest.hexdigest()


def _write(files: Mapping[str, bytes], folder: Path) -> Path:
    for path, content in files.items():
        target = folder / path
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes(content)
    return folder
