"""`mjbench.checkup`: what to do about a simulation that is slow, in one ranked list."""

import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from mjbench.api import model_sources
from mjbench.api.functions import with_options
from mjbench.api.result import Result
from mjbench.commands.checkup import driver, ranking, targets
from mjbench.commands.checkup.item import CheckupItem
from mjbench.commands.checkup.options import CheckupOptions
from mjbench.commands.checkup.show import CheckupDocument
from mjbench.errors import InputError, wrong_argument
from mjbench.measuring.timing import Progress

if TYPE_CHECKING:
    from mjbench.api.model_sources import Model


@dataclass(frozen=True, repr=False, eq=False)
class Checkup(Result):
    """What to do about a simulation, in one ranked list."""

    @property
    def items(self) -> tuple[CheckupItem, ...]:
        """What to do, the most important first."""
        return tuple(ranking.items(self.run))

    @property
    def document(self) -> CheckupDocument:
        return CheckupDocument.of(self.run)


@with_options(CheckupOptions)
def checkup(
    target: "Model", *arguments: str, options: CheckupOptions, on_progress: Progress | None = None
) -> Checkup:
    """Return what to do about a simulation that is slow, in a minute.

    The same as `mjbench TARGET`. A program runs unchanged, with its own output; all else is
    measured in child processes.

    Args:
      target: a model by name, path, MjModel or MjSpec; the path of a program; an environment
        by its Gymnasium id, or as `module:function`.
      *arguments: of a program.
      on_progress: called with what is measured now, and the share of all work that is done.

    Raises:
      InputError: there is no such target, or it could be several; it cannot be loaded or read.
      MachineError: a package is missing, or the process that steps crashed or hung.
      KeyboardInterrupt: Ctrl-C; no child process is left.
    """
    if not all(isinstance(argument, str) for argument in arguments):
        raise wrong_argument("arguments", arguments, "texts")
    plan, wait = driver.CheckupPlan.of(options), options.wait
    if isinstance(target, str | os.PathLike):
        source = targets.recognized(os.fspath(target), arguments, Path.cwd())
        return Checkup.of(driver.measurement(source, plan), wait, on_progress)
    if arguments:
        raise InputError("only a program has arguments")
    with model_sources.sources([target]) as (model,):
        return Checkup.of(driver.measurement(model, plan), wait, on_progress)
