"""Turn a name, a path or a model of the program into what child processes load.

A compiled model is saved as .mjb, which holds all that a step depends on, for as long as it is
needed; child processes run the same release and can load it.
"""

import contextlib
import itertools
import os
import sys
from collections.abc import Collection, Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

from mjbench.errors import InputError, one_line, shown
from mjbench.host import files
from mjbench.simulation import models
from mjbench.simulation.models import ModelSource

if TYPE_CHECKING:
    import mujoco

# A name as on the command line, a path, or a model of this process.
Model: TypeAlias = "str | os.PathLike[str] | mujoco.MjModel | mujoco.MjSpec"


def named(model: "Model") -> ModelSource:
    if isinstance(model, str | os.PathLike):
        return models.resolve(os.fspath(model))
    raise InputError(
        f"give a model's name or path, not {_described(model)}: other releases cannot load what"
        " this one compiled; MjSpec.to_file writes a model to a file"
    )


@contextlib.contextmanager
def sources(given: "Sequence[Model]") -> Iterator[list[ModelSource]]:
    """Yield the sources of models, each once; files of compiled ones last as long as the block.

    Raises:
      InputError: there is none, or no such model, or an MjSpec does not compile.
      MachineError: a compiled model cannot be saved.
    """
    models.check_any(given)
    sources_by_position = {
        i: named(model) for i, model in enumerate(given) if isinstance(model, str | os.PathLike)
    }
    taken = {source.name for source in sources_by_position.values()}
    with files.temporary_folder() as folder:
        for i, model in enumerate(given):
            if i not in sources_by_position:
                source = _saved(model, folder / f"{i}.mjb", taken)
                sources_by_position[i] = source
                taken.add(source.name)
        in_order = (sources_by_position[i] for i in range(len(given)))
        yield each_once(in_order)


def each_once(sources: Iterable[ModelSource]) -> list[ModelSource]:
    """Return the sources of different files, in their order."""
    return list({source.path: source for source in sources}.values())


def _saved(model: "Model", file: Path, taken: Collection[str]) -> ModelSource:
    """Return the source of a model of this process, saved to a file under a name of its own."""
    mujoco = sys.modules.get("mujoco")
    if mujoco is not None and isinstance(model, getattr(mujoco, "MjSpec", ())):
        model = _compiled(model)
    if mujoco is None or not isinstance(model, mujoco.MjModel):
        raise InputError(
            f"a model is one of {models.choices()}, an MjModel or an MjSpec,"
            f" not {_described(model)}"
        )
    models.save(model, file)
    name = shown(bytes(model.names).split(b"\0")[0].decode(errors="replace") or "model")
    names = itertools.chain([name], (f"{name} ({number})" for number in itertools.count(2)))
    return ModelSource(next(each for each in names if each not in taken), file)


def _compiled(spec: "mujoco.MjSpec") -> "mujoco.MjModel":
    try:
        return spec.copy().compile()
    except Exception as error:  # MuJoCo raises ValueError, FatalError, and others by release
        raise InputError(f"MuJoCo cannot compile the MjSpec: {one_line(error)}") from error


def _described(value: object) -> str:
    return "None" if value is None else f"an object of type {type(value).__name__}"
