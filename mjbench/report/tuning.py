"""What `mjbench tune` prints: which settings are recommended, what they cost, and what to paste."""

from collections.abc import Sequence
from dataclasses import dataclass

from rich.console import Console

from mjbench.instrument.units import plain
from mjbench.paired.records import Ratio
from mjbench.report import tables
from mjbench.report.starts import starts_lines
from mjbench.simulation import package_timer
from mjbench.status import Status
from mjbench.tuning import knobs
from mjbench.tuning.attempts import Effect
from mjbench.tuning.distance import Distance
from mjbench.tuning.records import SAME_ERROR, AttemptRow, Recommendation, TuneRecord
from mjbench.tuning.reference import REFINEMENT, Present
from mjbench.tuning.settings import LoopChange, Part, Setting, edits_of, label, loop_change

_RESULTS = {
    Effect.FREE: "same (free)",
    Effect.EQUIVALENT: "within tolerance (equivalent)",
    Effect.APPROXIMATE: "differ (approximate)",
}
# Settings that failed are named up to this number; of others, those that save most alone.
_MOST_FAILED, _MOST_ALONE = 5, 12


@dataclass(frozen=True)
class TunedRow:
    """A recommendation as a row of a flat table.

    Attributes:
      effect: on the motion.
      ratio: time of a simulated second over that of the present settings.
      error: of nine runs in ten, as a share of the motion.
    """

    model: str
    settings: str
    effect: Effect
    ratio: Ratio
    error: float


def rows(record: TuneRecord) -> list[TunedRow]:
    """Return the recommendations of a search, a row each."""
    return [
        TunedRow(record.model, label(each.settings), each.effect, each.ratio, each.error.share)
        for each in record.front
    ]


def print_record(out: Console, record: TuneRecord) -> None:
    """Print what a search came to."""
    heading, _, rest = conclusion(record).partition(": ")
    out.print(tables.headed(f"\n{heading}", f": {rest}"), soft_wrap=True)
    if record.present is None:
        return
    if record.front:
        _print_front(out, record, record.present)
    _print_alone(out, record)
    for each in advised(record):
        out.print(f"To apply {label(each.settings)}:", soft_wrap=True, markup=False)
        for line in paste_lines(each.settings):
            out.print(line, soft_wrap=True, markup=False)
    for line in notes(record):
        out.print(line, soft_wrap=True)


def conclusion(record: TuneRecord) -> str:
    """Return what a search came to, in one sentence; what changes no result comes first."""
    model = record.model
    if record.status == Status.INTERRUPTED and not record.front:
        return f"{model}: interrupted before settings could be recommended"
    if record.status not in (Status.OK, Status.INTERRUPTED):
        return f"{model}: {record.status}: {record.detail}"
    listed = advised(record)
    if not listed:
        return f"{model}: no settings are certainly faster{_within(record)}"
    return f"{model}: {'; '.join(_part(each, record) for each in listed)}"


def advised(record: TuneRecord) -> list[Recommendation]:
    """Return the fastest recommendation, after those that change less."""
    best = record.best()
    if best is None:
        return []
    exact = [each for each in record.front if each.effect.rank < best.effect.rank]
    return [*(each for each in exact if each.is_allowed), best]


def _part(each: Recommendation, record: TuneRecord) -> str:
    """Return what a recommendation comes to."""
    return (
        f"{tables.factor(1 / each.ratio.estimate)} times as fast{_results(each, record)}:"
        f" {label(each.settings)}"
    )


def _within(record: TuneRecord) -> str:
    """Return the error that is allowed, as a sentence goes on."""
    if record.only == Effect.FREE:
        return " with the same results"
    if record.only == Effect.EQUIVALENT:
        return " within the solver's tolerance"
    if record.max_error is None:
        return " without a larger error"
    return f" with an error of at most {percent(record.max_error)} of the motion"


def _results(each: Recommendation, record: TuneRecord) -> str:
    if each.effect == Effect.FREE:
        return " with the same results"
    if each.effect == Effect.EQUIVALENT:
        return " within the solver's tolerance"
    assert record.present is not None, "it was measured"
    if (
        record.max_error is None
        and each.error.share <= (1 + SAME_ERROR) * record.present.error.share
    ):
        return " without a larger error"
    return f" with an error of at most {percent(each.error.share)} of the motion"


def _print_front(out: Console, record: TuneRecord, present: Present) -> None:
    """Print the table of what was confirmed."""
    listed = advised(record)
    table = tables.plain_table(
        ["", "results", "time of a simulated second", "error", "settings"], right=(2, 3)
    )
    table.add_row("present", "", "1", _error(present.error), "as they are")
    for each in record.front:
        table.add_row(
            "recommended" if each in listed else "",
            _RESULTS[each.effect],
            interval(each.ratio),
            _error(each.error),
            label(each.settings),
        )
    out.print(table)


def _print_alone(out: Console, record: TuneRecord) -> None:
    """Print what each setting saves alone, and why it can."""
    rows = [row for row in record.attempts if len(row.settings) == 1 and is_faster(row)]
    if not rows:
        return
    rows.sort(key=lambda row: row.ratio.estimate if row.ratio else 1.0)
    table = tables.plain_table(["setting alone", "results", "saves", "why it can"], right=(2,))
    for row in rows[:_MOST_ALONE]:
        (setting,) = row.settings
        assert row.ratio is not None and row.accuracy is not None, "it was compared"
        table.add_row(
            setting.label,
            _RESULTS[row.accuracy.effect],
            f"{100 * (1 - row.ratio.estimate):.1f} %",
            why(setting, record),
        )
    out.print(table)


def is_faster(row: AttemptRow) -> bool:
    """Return whether settings are certainly faster in fresh processes."""
    return row.ratio is not None and row.ratio.high is not None and row.ratio.high < 1


def why(setting: Setting, record: TuneRecord) -> str:
    """Return why a setting can help: the stages of a step that it changes, and what was seen."""
    knob = knobs.find(setting.knob)
    parts = []
    if knob.stages and record.stages is not None:
        share = sum(record.stages.get(stage, 0.0) for stage in knob.stages)
        parts.append(f"{', '.join(knob.stages)}: {100 * share:.0f} % of a step")
    if knob.helps:
        parts.append(knob.helps)
    if setting.evidence:
        parts.append(setting.evidence)
    if setting.loses:
        parts.append(f"gives up {setting.loses}")
    return "; ".join(parts)


def paste_lines(settings: Sequence[Setting]) -> list[str]:
    """Return the lines of MJCF and of Python that make some settings."""
    lines = []
    edits = edits_of(settings)
    of_option = [edit for edit in edits if edit.part == Part.OPTION]
    flags = [edit for edit in edits if edit.part == Part.FLAG]
    if of_option or flags:
        attributes = "".join(f' {edit.name}="{edit.value}"' for edit in of_option)
        inner = "".join(f' {edit.name}="{edit.value}"' for edit in flags)
        flag = f"<flag{inner}/></option>" if flags else ""
        lines.append(f"    <option{attributes}{'>' if flags else '/>'}{flag}")
    compiler = [edit for edit in edits if edit.part == Part.COMPILER]
    if compiler:
        lines.append(
            "    <compiler" + "".join(f' {edit.name}="{edit.value}"' for edit in compiler) + "/>"
        )
    excluded = [edit for edit in edits if edit.part == Part.EXCLUDE]
    if excluded:
        lines.append(
            f"    <contact> with {len(excluded)} <exclude …/>: --write writes them to a copy of"
            " the model, --json names them"
        )
    code = _code(loop_change(settings))
    if any(edit.name == "timestep" for edit in of_option):
        code.append("# hold each control for fewer steps (frame_skip), so that it lasts as long")
    return [
        *(["  in the model, last in <mujoco>:", *lines] if lines else []),
        *(["  in the program:", *(f"    {line}" for line in code)] if code else []),
    ]


def _code(loop: LoopChange) -> list[str]:
    """Return the Python that a change of the loop stands for."""
    code = [package_timer.OFF_SNIPPET] if loop.is_clock_off else []
    if loop.engine_threads:
        code.append(f"mujoco.mju_threadpool(data, {loop.engine_threads})")
    return code


def notes(record: TuneRecord) -> list[str]:
    """Return what the figures rest on, and what was not recommended, a line each."""
    present = record.present
    assert present is not None, "it was measured"
    lines = [
        f"Error: distance from the model at 1/{REFINEMENT} of its timestep with a converged solver,"
        f" over {plain(present.horizon_s, 3)} s of {present.nrun} runs; nine runs in ten stay below"
        f" it. Rounding alone: {percent(present.rounding.share)}. The solver alone:"
        f" {percent(present.solver.share)}."
    ]
    if not present.is_comparable:
        lines.append(
            "These runs part too soon to compare errors: only settings that change no state are"
            " recommended"
        )
    lines += starts_lines(present.starts)
    lines += [
        f"Withdrawn by the second look: {label(each.settings)}: {each.reason}"
        for each in record.withdrawn
    ]
    failed = [row for row in record.attempts if row.status != Status.OK]
    lines += [f"Failed: {label(row.settings)}: {row.detail}" for row in failed[:_MOST_FAILED]]
    if len(failed) > _MOST_FAILED:
        lines.append(f"{len(failed) - _MOST_FAILED} more failed")
    if record.untried:
        lines.append(f"There was no time for {record.untried} settings: give a longer --budget")
    lines += [
        f"Geom {mesh.geom} collides as the mesh {mesh.mesh}, which fills"
        f" {100 * mesh.share:.0f} % of a {mesh.primitive}"
        for mesh in record.meshes
    ]
    return lines


def _error(error: Distance) -> str:
    """Return an error as a share of the motion, and in units."""
    position = error.position
    parts = [
        *([f"{_length(position.m)}"] if position.m is not None else []),
        *([f"{plain(position.rad, 2)} rad"] if position.rad is not None else []),
    ]
    return f"{percent(error.share)} of the motion ({', '.join(parts)})"


def _length(metres: float) -> str:
    """Return a length in the unit that suits it."""
    for unit, size in (("m", 1.0), ("mm", 1e-3), ("µm", 1e-6)):
        if metres >= size:
            return f"{plain(metres / size, 2)} {unit}"
    return f"{metres:.1g} m"


def percent(share: float) -> str:
    """Return a share in percent, in two digits."""
    return f"{100 * share:.2g} %" if share < 1e-4 else f"{plain(100 * share, 2)} %"


def interval(ratio: Ratio) -> str:
    """Return a ratio with its interval."""
    if ratio.low is None or ratio.high is None:
        return f"{ratio.estimate:.3f}"
    return f"{ratio.estimate:.3f} ({ratio.low:.3f} to {ratio.high:.3f})"
