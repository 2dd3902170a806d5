"""A model with settings applied: compiled in memory, or written as a copy of the user's MJCF.

All but `check_source` and `copy_in_child` loads the model, so it runs in a child process.
"""

import copy
import os
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import mujoco

from mjbench.errors import InputError, one_line, shown, writing
from mjbench.host import files, isolate
from mjbench.host.isolate import Channel
from mjbench.simulation import compat, model_options, models
from mjbench.simulation.model_guard import ModelGuard
from mjbench.simulation.models import ModelSource
from mjbench.tuning import mjcf_edit, mjcf_sections
from mjbench.tuning.settings import Edit, Part

_COMPILED = ".mjb"
_KEYWORDS = {"true": 1, "false": 0}


def check_source(source: ModelSource) -> None:
    """Refuse a model of which no copy can be written, as far as its name tells."""
    if source.path.suffix.lower() != ".xml":
        raise InputError(f"--write: {source.name} is no MJCF file: give the one it comes from")


def copy_in_child(
    source: ModelSource, edits: Sequence[Edit] | None, target: Path, limit_s: float
) -> None:
    """Do what `write` does, in a child process; without edits, what `check_target` does."""
    isolate.call(_copy, source, edits, target.absolute(), limit_s=limit_s)


def _copy(
    source: ModelSource, edits: Sequence[Edit] | None, target: Path, channel: Channel
) -> None:
    channel.doing(f"writing {target}")
    if edits is None:
        check_target(source, target)
    else:
        write(source, edits, target)


def compiled(source: ModelSource, edits: Sequence[Edit]) -> mujoco.MjModel:
    """Return the compiled model of `source` with edits applied; no file is written.

    An .mjb file, and a release without MjSpec (before 3.2), can have edits of `<option>` alone.

    Raises:
      InputError: MuJoCo rejects the file or an edit, or warns because of an edit.
    """
    if source.path.suffix.lower() == _COMPILED or compat.spec_unavailable():
        return with_options(source, models.load(source), edits)
    model, messages = _compiled(source, edits)
    if messages and edits:
        _, usual = _compiled(source, [])
        for message in messages:
            if message not in usual:
                raise InputError(f"{_label(source, edits)}: MuJoCo warns: {one_line(message)}")
    return model


def write(source: ModelSource, edits: Sequence[Edit], target: Path) -> None:
    """Write a copy of an MJCF file with edits applied, complete or not at all.

    The copy takes its place only when MuJoCo compiles it, in its folder, to what `compiled`
    returns. A file that is there is replaced; where `target` is a link, the file that it leads to.

    Raises:
      InputError: `source` is no MJCF, MuJoCo rejects an edit, `target` is a file that the model is
        read from, or the copy compiles to something else, as where its meshes are not beside it.
      MachineError: the file cannot be written.
    """
    file = _file_of(source, target)
    text, absent = _read(source.path), _absent(source, edits)
    try:
        text = mjcf_edit.edited(text, absent)
    except InputError as error:
        raise InputError(f"{source.name}: {error}") from error
    with writing(target), files.replacing(file) as partial:
        partial.write_bytes(text)
        _check_copy(source, edits, target, partial)


def check_target(source: ModelSource, target: Path) -> None:
    """Refuse a place for a copy as `write` would, before there are edits; nothing stays there."""
    file = _file_of(source, target)
    with writing(target):
        copy = files.create_beside(file)
        try:
            copy.write_bytes(_read(source.path))
            _check_copy(source, [], target, copy)
        finally:
            copy.unlink(missing_ok=True)


def _file_of(source: ModelSource, target: Path) -> Path:
    """Return the file that a copy is written to: where `target` is a link, the one it leads to.

    Refuse what cannot be the copy: no MJCF by its name, no regular file, or one that is read.
    """
    if source.path.suffix.lower() == _COMPILED:
        raise InputError(f"{source.name} is compiled: give the MJCF file that it comes from")
    with writing(target):
        file = Path(os.path.realpath(target))
    if file.suffix.lower() != ".xml":
        raise InputError(f"{shown(str(target))}: the name of a copy ends in .xml")
    if file.exists() and not file.is_file():
        raise InputError(f"{shown(str(target))} is not a regular file")
    if file.exists() and any(file.samefile(path) for path in _inputs(source.path)):
        raise InputError(
            f"{shown(str(target))} is a file that {source.name} is read from: choose another"
        )
    return file


# -- edits of a model in memory ---------------------------------------------------------------


def with_options(
    source: ModelSource, model: mujoco.MjModel, edits: Sequence[Edit]
) -> mujoco.MjModel:
    """Return a copy of a model, compiled from `source`, with edits of `<option>` applied.

    Raises:
      InputError: MuJoCo has no such option or value, or an edit is none of `<option>`.
    """
    model = copy.copy(model)
    for edit in edits:
        if edit.is_of_options:
            _set_option(source, model.opt, edit)
            continue
        reason = compat.spec_unavailable() or "it is compiled, give the MJCF that it comes from"
        raise InputError(f"{_label(source, [edit])}: {reason}")
    return model


def _compiled(source: ModelSource, edits: Sequence[Edit]) -> tuple[mujoco.MjModel, list[str]]:
    with warnings.catch_warnings(record=True, action="always") as caught:
        spec = _spec(source)
        for edit in edits:
            _apply(source, spec, edit)
        try:
            model = spec.compile()
        except Exception as error:  # MuJoCo raises ValueError, FatalError, and others by release
            raise InputError(
                f"{_label(source, edits)}: MuJoCo cannot compile it: {one_line(error)}"
            ) from error
    return model, [str(warning.message) for warning in caught]


def _spec(source: ModelSource) -> Any:
    try:
        return mujoco.MjSpec.from_file(str(source.path))
    except Exception as error:  # as above
        raise InputError(f"{source.name}: MuJoCo cannot load it: {one_line(error)}") from error


def _apply(source: ModelSource, spec: Any, edit: Edit) -> None:
    if edit.part == Part.EXCLUDE:
        if not _is_excluded(spec, edit):
            exclude = spec.add_exclude()
            exclude.bodyname1, exclude.bodyname2 = edit.name, edit.value
    elif edit.part == Part.COMPILER:
        _set_compiler(source, spec, edit)
    else:
        _set_option(source, spec.option, edit)


def _set_option(source: ModelSource, options: Any, edit: Edit) -> None:
    set_one = model_options.set_flag if edit.part == Part.FLAG else model_options.set_attribute
    try:
        set_one(options, edit.name, edit.value)
    except InputError as error:
        raise InputError(f"{source.name}: {error}") from error


def _set_compiler(source: ModelSource, spec: Any, edit: Edit) -> None:
    present = getattr(getattr(spec, "compiler", None), edit.name, None)
    if not isinstance(present, bool | int | float):
        raise InputError(
            f"{_label(source, [edit])}: MuJoCo {mujoco.mj_versionString()} has no such attribute"
            " that is a number, true or false"
        )
    try:  # some releases have integers for true and false
        number = _KEYWORDS.get(edit.value, edit.value)
        value = _KEYWORDS[edit.value] if isinstance(present, bool) else float(number)
    except (KeyError, ValueError):
        kind = "true or false" if isinstance(present, bool) else "a number, true or false"
        raise InputError(f"{_label(source, [edit])}: its value is {kind}") from None
    setattr(spec.compiler, edit.name, type(present)(value))


def _is_excluded(spec: Any, edit: Edit) -> bool:
    pair = {edit.name, edit.value}
    return any({exclude.bodyname1, exclude.bodyname2} == pair for exclude in spec.excludes)


def _label(source: ModelSource, edits: Sequence[Edit]) -> str:
    return f"{source.name} with {one_line(', '.join(map(_shown, edits)))}" if edits else source.name


def _shown(edit: Edit) -> str:
    if edit.part == Part.EXCLUDE:
        return f"exclude {edit.name} {edit.value}"
    kind = "" if edit.part == Part.OPTION else f"{edit.part} "
    return f"{kind}{edit.name}={edit.value}"


# -- the copy -----------------------------------------------------------------------------------


def _inputs(path: Path) -> Iterator[Path]:
    """Yield the files of MJCF that a model is read from, as far as they can be read.

    MuJoCo looks for an included file in the folders of the model and of the file including it.
    """
    pending, visited = [path], set()
    while pending:
        file = pending.pop()
        real = os.path.realpath(file)
        if real in visited or not file.is_file():
            continue
        visited.add(real)
        yield file
        try:
            names = mjcf_sections.parse(_read(file)).files
        except InputError:  # `edited` and MuJoCo say more of it
            continue
        pending += [folder / name for name in names for folder in (path.parent, file.parent)]


def _read(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise InputError(f"cannot read {shown(str(path))}: {error.strerror}") from error


def _absent(source: ModelSource, edits: Sequence[Edit]) -> list[Edit]:
    """Return the edits that are not of pairs which a file included by the model excludes."""
    if not any(edit.part == Part.EXCLUDE for edit in edits) or compat.spec_unavailable():
        return list(edits)
    with warnings.catch_warnings(action="ignore"):  # `compiled` reports those of edits
        spec = _spec(source)
    return [e for e in edits if e.part != Part.EXCLUDE or not _is_excluded(spec, e)]


def _check_copy(source: ModelSource, edits: Sequence[Edit], target: Path, copy: Path) -> None:
    expected = ModelGuard(compiled(source, edits))
    try:
        model = mujoco.MjModel.from_xml_path(str(copy))
    except Exception as error:  # MuJoCo raises ValueError, FatalError, and others by release
        reason = f"there, MuJoCo cannot load it: {one_line(error)}"
    else:
        field = expected.difference_apart_from_paths(model)
        if field is None:
            return
        reason = f"there, its {field} is not that of {_label(source, edits)}"
    moved = copy.parent.resolve() != source.path.parent.resolve()
    advice = f"; write it to {source.path.parent}, beside what it refers to" if moved else ""
    raise InputError(f"{shown(str(target))} is not written: {reason}{advice}")
