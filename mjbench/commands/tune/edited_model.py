"""A model with settings applied, compiled in memory; runs in a child process."""

import copy
import warnings
from collections.abc import Sequence
from typing import Any

import mujoco

from mjbench.commands.tune.settings import Edit, Part
from mjbench.errors import InputError, one_line
from mjbench.simulation import compat, model_options, models
from mjbench.simulation.models import ModelSource

_COMPILED = ".mjb"


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
    elif edit.part in (Part.COMPILER, Part.MESHES, Part.TENDON):
        try:
            if edit.part == Part.COMPILER:
                setattr(spec.compiler, edit.name, edit.value == "true")
            elif edit.part == Part.TENDON:
                spec.delete(spec.tendon(edit.name))
            for mesh in spec.meshes if edit.part == Part.MESHES else ():
                setattr(mesh, edit.name, int(edit.value))
        except AttributeError:
            version = mujoco.mj_versionString()
            raise InputError(
                f"{_label(source, [edit])}: MuJoCo {version} has no such attribute"
            ) from None
    else:
        _set_option(source, spec.option, edit)


def _set_option(source: ModelSource, options: Any, edit: Edit) -> None:
    set_one = model_options.set_flag if edit.part == Part.FLAG else model_options.set_attribute
    try:
        set_one(options, edit.name, edit.value)
    except InputError as error:
        raise InputError(f"{source.name}: {error}") from error


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
