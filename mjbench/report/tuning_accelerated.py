"""What `mjbench tune --engine` prints: settings of MJX or Warp, and what transfers to C."""

from collections.abc import Sequence
from dataclasses import dataclass

from rich.console import Console

from mjbench.instrument.units import plain
from mjbench.paired.records import Ratio
from mjbench.report import tables, tuning
from mjbench.report.starts import starts_lines
from mjbench.report.tuning import interval, paste_lines, percent
from mjbench.status import Status
from mjbench.tuning.accelerated_records import (
    EngineAttempt,
    EngineFacts,
    EngineProgram,
    EngineTuneRecord,
)
from mjbench.tuning.accelerated_settings import EngineSetting, buffer_sizes_of
from mjbench.tuning.records import TuneRecord
from mjbench.tuning.settings import label

_NAMES = {"mjx": "MJX", "warp": "Warp"}


@dataclass(frozen=True)
class EngineTunedRow:
    """A recommendation as a row of a flat table.

    Attributes:
      ratio: time of a batched step over that with the present settings.
      error: transfer error of nine runs in ten, as a share of the motion.
    """

    model: str
    engine: str
    settings: str
    ratio: Ratio
    error: float


def rows(record: EngineTuneRecord) -> list[EngineTunedRow]:
    """Return the recommendations of a search, a row each."""
    return [
        EngineTunedRow(
            record.model, record.engine, label(each.settings), each.ratio, each.error.share
        )
        for each in record.front
    ]


def print_any(out: Console, record: TuneRecord | EngineTuneRecord) -> None:
    """Print what a search came to, whichever engine it was for."""
    if isinstance(record, EngineTuneRecord):
        print_record(out, record)
    else:
        tuning.print_record(out, record)


def print_record(out: Console, record: EngineTuneRecord) -> None:
    """Print what a search came to."""
    heading, _, rest = conclusion(record).partition(": ")
    out.print(tables.headed(f"\n{heading}", f": {rest}"), soft_wrap=True)
    if record.facts is None or record.present is None:
        return
    _print_table(out, record, record.present)
    best = record.best()
    if best is not None:
        for line in [*paste_lines(best.settings), *_buffer_lines(best.settings)]:
            out.print(line, soft_wrap=True, markup=False)
    for line in notes(record, record.facts):
        out.print(line, soft_wrap=True, markup=False)


def engine_name(engine: str) -> str:
    """Return the name of an engine, as people know it."""
    return _NAMES.get(engine, engine)


def conclusion(record: EngineTuneRecord) -> str:
    """Return what a search came to, in one sentence."""
    subject = f"{record.model} on {engine_name(record.engine)}"
    if record.status == Status.INTERRUPTED:
        return f"{subject}: interrupted before settings could be recommended"
    if record.status != Status.OK:
        return f"{subject}: {record.status}: {record.detail}"
    within = (
        "without a larger transfer error"
        if record.max_error is None
        else f"with a transfer error of at most {percent(record.max_error)} of the motion"
    )
    best = record.best()
    if best is None:
        return f"{subject}: no settings are certainly faster {within}"
    return (
        f"{subject}: {tables.factor(1 / best.ratio.estimate)} times as fast {within}:"
        f" {label(best.settings)}"
    )


def _print_table(out: Console, record: EngineTuneRecord, present: EngineProgram) -> None:
    """Print the recommendations, and all that was tried."""
    table = tables.plain_table(
        ["settings", "time of a batched step", "transfer error", "compile s"], right=(1, 2, 3)
    )
    table.add_row("as they are", "1", _error(present), plain(present.compile_s, 3))
    for each in record.front:
        table.add_row(
            f"{label(each.settings)} (recommended)",
            interval(each.ratio),
            f"{percent(each.error.share)} of the motion",
            plain(each.program.compile_s, 3),
        )
    for attempt in tried(record):
        assert attempt.program is not None and attempt.time_ratio is not None, "it did not fail"
        table.add_row(
            label(attempt.settings),
            f"about {attempt.time_ratio:.2f}",
            _error(attempt.program),
            plain(attempt.program.compile_s, 3),
        )
    out.print(table)


def tried(record: EngineTuneRecord) -> list[EngineAttempt]:
    """Return the attempts that did not fail and are not recommended, the fastest first."""
    recommended = {label(each.settings) for each in record.front}
    others = [
        each
        for each in record.attempts
        if each.time_ratio is not None and label(each.settings) not in recommended
    ]
    return sorted(others, key=lambda each: each.time_ratio or 1.0)


def notes(record: EngineTuneRecord, facts: EngineFacts) -> list[str]:
    """Return what the figures rest on, and what was not recommended, a line each."""
    lines = [
        f"A transfer error is the distance of {facts.precision} runs from C's with the present"
        f" settings, over {plain(facts.horizon_s, 3)} s of {facts.nrun} runs: nine runs in ten"
        f" differ by no more. Rounding starts and controls to {facts.precision} alone makes"
        f" {percent(facts.rounding.share)}.",
        f"A batched step is of {record.nbatch} simulations on {facts.device}; compiling is not in"
        " its time. Ratios with an interval are from fresh processes, others from one.",
    ]
    if record.engine == "warp":
        lines.append(
            "Warp compiles kernels once in a process, for the present settings: other settings"
            " compile what they do not share."
        )
    best = record.best()
    lines += [
        f"{setting.label}: {setting.evidence}. A simulation that needs more overflows."
        for setting in (best.settings if best else ())
        if setting.evidence
    ]
    lines += starts_lines(facts.starts)
    lines += [f"Withdrawn: {label(each.settings)}: {each.reason}" for each in record.withdrawn]
    lines += [
        f"Failed: {label(each.settings)}: {each.detail}"
        for each in record.attempts
        if each.status != Status.OK
    ]
    if record.untried:
        lines.append(f"There was no time for {record.untried} settings: give a longer --budget")
    return lines


def _buffer_lines(settings: Sequence[EngineSetting]) -> list[str]:
    """Return the Python that makes buffers of some sizes."""
    sizes = "".join(f", {name}={size}" for name, size in buffer_sizes_of(settings).items())
    call = f"mujoco_warp.make_data(model, nworld=nworld{sizes})"
    return ["In the program:", f"  data = {call}"] if sizes else []


def _error(program: EngineProgram) -> str:
    return "" if program.error is None else f"{percent(program.error.share)} of the motion"
