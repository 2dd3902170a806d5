"""Measure models one after the other: one that fails affects only its own rows."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from mjbench.cli.context import RunContext, Storage
from mjbench.cli.group import report_line
from mjbench.cli.shared import start_plan
from mjbench.errors import Failure, MjbenchError, failure_of
from mjbench.simulation.models import ModelSource

if TYPE_CHECKING:
    from mjbench.report.kinds import Kind
    from mjbench.simulation.starts import StartPlan

_T = TypeVar("_T")


def measure_each(
    names: Sequence[str],
    kind: "Kind",
    measure: "Callable[[ModelSource, StartPlan, float], Sequence[Any]]",
    arguments: Mapping[str, Any] | None = None,
    *,
    code: bool = False,
    settle_s: float | None,
    states_file: Path | None,
    actions_file: Path | None = None,
    time_limit: float,
    results: Path,
    wait: bool,
    json_file: str | None,
) -> None:
    """Measure models as the options of a command say, print and store their rows, and exit.

    Args:
      measure: returns the rows of a model, from its start states, with a time limit in seconds. A
        model that fails has one row, of its name and the failure.
      arguments: for the run file's header, beside the models and their starts.
      code: whether snippets are printed, too.
    """
    from mjbench.simulation import models

    sources = [models.resolve(name) for name in names]
    starts = start_plan(settle_s, states_file, actions_file)
    files = [*(source.path for source in sources), *starts.files]
    of_models = {"models": [source.name for source in sources]}
    storage = Storage(results, {**of_models, **(arguments or {}), "starts": starts})
    all_rows: list[Any] = []
    with RunContext(kind.commands[0], json_file, files, storage, wait) as run:
        for source in sources:
            rows = measure_or_report(source, lambda source: measure(source, starts, time_limit))
            if isinstance(rows, Failure):
                record_type: Any = kind.records[0]
                rows = [record_type(model=source.name, status=rows.status, detail=rows.detail)]
            else:
                run.show_results(kind, rows, code)
            all_rows += rows
            for row in rows:
                run.record(row)
        run.write_results(kind)
    run.exit(row.status for row in all_rows)


def measure_or_report(source: ModelSource, measure: Callable[[ModelSource], _T]) -> _T | Failure:
    """Return what `measure` returns for a model; or how it failed, after a line on stderr."""
    try:
        return measure(source)
    except MjbenchError as error:
        detail = failure_of(error).detail.removeprefix(f"{source.name}: ")
        report_line(f"{source.name}: {detail}")
        return Failure(error.status, detail)
