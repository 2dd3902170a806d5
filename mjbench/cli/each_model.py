"""Measure models one after the other: one that fails affects only its own rows."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from mjbench.cli.context import RunContext, Storage
from mjbench.cli.group import report_line
from mjbench.cli.shared import start_plan
from mjbench.errors import Failure, MjbenchError, failure_of
from mjbench.simulation.models import ModelSource

if TYPE_CHECKING:
    from rich.console import Console

    from mjbench.simulation.starts import StartPlan

_T = TypeVar("_T")


@dataclass(frozen=True)
class LoopOptions:
    """Options that `overhead`, `profile` and `latency` share, as click parses them."""

    settle_s: float | None
    states_file: Path | None
    time_limit: float
    results: Path
    wait: bool
    json_file: str | None
    actions_file: Path | None = None


def measure_each(
    command: str,
    names: Sequence[str],
    options: LoopOptions,
    row_type: Any,
    document_type: Any,
    measure: "Callable[[ModelSource, StartPlan], Sequence[Any]]",
    show: "Callable[[Console, Sequence[Any]], None]",
    arguments: Mapping[str, Any] | None = None,
) -> None:
    """Measure models, print and store the rows of each, and end the process.

    Args:
      row_type: of the rows; a model that fails has one with its name and the failure alone.
      document_type: of the JSON document.
      measure: returns the rows of a model.
      show: prints them.
      arguments: of the command, for the run file's header, beside the models and their starts.
    """
    from mjbench.simulation import models

    sources = [models.resolve(name) for name in names]
    starts = start_plan(options.settle_s, options.states_file, options.actions_file)
    files = [*(source.path for source in sources), *starts.files]
    of_models = {"models": [source.name for source in sources]}
    storage = Storage(options.results, {**of_models, **(arguments or {}), "starts": starts})
    results: list[Any] = []
    with RunContext(command, options.json_file, files, storage, options.wait) as run:
        for source in sources:
            rows = measure_or_report(source, lambda source: measure(source, starts))
            if isinstance(rows, Failure):
                rows = [row_type(model=source.name, status=rows.status, detail=rows.detail)]
            else:
                show(run.out, rows)
            results += rows
            for row in rows:
                run.record(row)
        run.write(document_type(machine=run.machine, results=results))
    run.exit(row.status for row in results)


def measure_or_report(source: ModelSource, measure: Callable[[ModelSource], _T]) -> _T | Failure:
    """Return what `measure` returns for a model; or how it failed, after a line on stderr."""
    try:
        return measure(source)
    except MjbenchError as error:
        detail = failure_of(error).detail.removeprefix(f"{source.name}: ")
        report_line(f"{source.name}: {detail}")
        return Failure(error.status, detail)
