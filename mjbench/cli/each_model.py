"""Measure models one after the other: one that fails affects only its own row."""

from collections.abc import Callable
from typing import TypeVar

from mjbench.cli.group import report_line
from mjbench.errors import Failure, MjbenchError, failure_of
from mjbench.simulation.models import ModelSource

_T = TypeVar("_T")


def measure_or_report(source: ModelSource, measure: Callable[[ModelSource], _T]) -> _T | Failure:
    """Return what `measure` returns for a model; or how it failed, after a line on stderr."""
    try:
        return measure(source)
    except MjbenchError as error:
        detail = failure_of(error).detail.removeprefix(f"{source.name}: ")
        report_line(f"{source.name}: {detail}")
        return Failure(error.status, detail)
