"""What `mjbench compare` prints: what follows for each model, its table, and notes."""

import math
from collections.abc import Sequence

from rich.console import Console, Group
from rich.table import Table
from rich.text import Text

from mjbench.comparison.plan import Variant
from mjbench.comparison.records import ModelRecord
from mjbench.paired.race_record import Loop, RaceRecord
from mjbench.paths import BASE
from mjbench.paths.accelerated import keyword_arguments
from mjbench.report import tables
from mjbench.report.advice import Advice, advise, advise_clock
from mjbench.report.conclusions import (
    cautions,
    clock_conclusion,
    conclusion,
    thread_conclusion,
)
from mjbench.report.crossovers import crossovers, describe_crossover
from mjbench.report.results import ModelResults, PathResult
from mjbench.report.starts import starts_lines
from mjbench.report.thread_advice import advise_threads
from mjbench.report.work_crossovers import describe_work_crossover, work_crossovers
from mjbench.simulation import accelerated_limits, package_timer
from mjbench.simulation.accelerated_limits import Precision
from mjbench.simulation.workload import Product
from mjbench.status import Status

# A race that was not decided needs this many times the time, and seconds at least.
_LONGER, _LONGER_BUDGET_S = 5, 120


def print_models(out: Console, models: Sequence[ModelResults], code: bool = False) -> None:
    """Print what comparisons of models come to, one after the other and together.

    Args:
      models: in the order they were measured.
      code: whether to print the Python of the paths that are advised.
    """
    for name in dict.fromkeys(each.model.model for each in models):
        print_model(out, [each for each in models if each.model.model == name], code)
    print_together(out, models)


def print_together(out: Console, models: Sequence[ModelResults]) -> None:
    """Print what several models, or one at several sizes, come to together."""
    print_crossovers(out, models)
    if len({each.model.model for each in models}) > 1:
        print_summary(out, models)


def print_model(out: Console, sizes: Sequence[ModelResults], code: bool = False) -> None:
    """Print what follows for one model at each of its sizes, and one table of all sizes.

    Args:
      sizes: the results of the model, one a size.
      code: whether to print the Python of the paths that are advised.
    """
    timed = [each for each in sizes if _has_results(each)]
    for model_results in sizes:
        out.print()
        print_lines(out, caution_lines(model_results))
        print_lines(out, [heading(model_results.model)])
        if model_results in timed:
            print_lines(out, conclusion_lines(model_results, len(sizes) > 1))
    if timed:
        out.print(path_table(timed))
    compiled = [r for each in timed for r in each.results if r.compile_s is not None]
    if compiled:
        out.print(_compile_table(compiled))
    about = [line for each in timed for line in notes(each)]
    about += [line for each in sizes for line in detail_lines(each.model)]
    print_lines(out, list(dict.fromkeys(about)))
    if code:
        _print_code(out, [advice for each in timed for advice in advise(each)])


def shown_so_far(sizes: Sequence[ModelResults]) -> Group | None:
    """Return what is shown of a model while it is measured; None before there is a speed."""
    timed = [each for each in sizes if any(result.is_timed for result in each.results)]
    if not timed:
        return None
    last = timed[-1]
    lines = [*caution_lines(last), *conclusion_lines(last, len(timed) > 1)]
    return Group(*lines, path_table(timed))


def print_lines(out: Console, lines: Sequence[str | Text]) -> None:
    """Print lines, which the terminal wraps."""
    for line in lines:
        out.print(line, soft_wrap=True)


def _has_results(model_results: ModelResults) -> bool:
    is_ok = model_results.model.status == Status.OK
    return is_ok or any(r.is_timed or r.agrees is False for r in model_results.results)


def conclusion_lines(model_results: ModelResults, names_size: bool) -> list[str | Text]:
    """Return what follows from a comparison, for each loop, and for MuJoCo's timer.

    Args:
      names_size: whether lines say how many simulations there were, because others stand beside.
    """
    lines: list[str | Text] = [
        tables.headed(*conclusion(advice, names_size)) for advice in advise(model_results)
    ]
    lines += [
        tables.headed(*thread_conclusion(row, names_size)) for row in advise_threads(model_results)
    ]
    if (clock := advise_clock(model_results)) is not None:
        lines.append(tables.headed(*clock_conclusion(clock, names_size)))
    return lines


def print_summary(out: Console, models: Sequence[ModelResults]) -> None:
    """Print what is advised on every model, one row a model and loop."""
    advice = [row for model_results in models for row in advise(model_results)]
    if not advice:
        return
    sizes = {(row.model, row.nbatch) for row in advice}
    has_sizes = len({name for name, _ in sizes}) < len(sizes)
    headings = ["model", *(["simulations"] if has_sizes else []), "loop", "advised"]
    table = tables.plain_table(
        [*headings, "speed-up", "95 %", "× real time"],
        right=range(len(headings), len(headings) + 3),
    )
    names = tables.short_names([row.model for row in advice])
    for row in advice:
        size = [f"{row.nbatch:,}"] if has_sizes else []
        table.add_row(
            names[row.model],
            *size,
            row.loop,
            f"{mark(row.is_certain)} {Variant(row.path, row.options)}",
            tables.factor(row.speedup.estimate) if row.speedup else "1",
            tables.ends(row.speedup),
            _times_real_time(row.realtime_factor),
        )
    out.print()
    out.print(tables.headed("Advice", " (speed-ups over the plain loop; ? is not certain)"))
    out.print(table)


def mark(is_certain: bool) -> str:
    """Return the mark of what is advised."""
    return "✓" if is_certain else "?"


def marks(model_results: ModelResults) -> dict[str, str]:
    """Return the marks of advised paths: ✓ where that is certain, ? where it is not.

    The keys are the paths, each with its options.
    """
    return {
        str(Variant(row.path, row.options)): mark(row.is_certain)
        for row in sorted(advise(model_results), key=lambda row: not row.is_certain)
    }


def print_code_hint(out: Console, models: Sequence[ModelResults]) -> None:
    """Print which flag prints the code of what is advised, where anything is."""
    if any(advise(model_results) for model_results in models):
        out.print("--code prints the Python code of the paths that are advised.", soft_wrap=True)


def print_crossovers(out: Console, models: Sequence[ModelResults]) -> None:
    """Print from which batch size on accelerated paths overtake C, and Ray the other paths."""
    results = [result for model_results in models for result in model_results.results]
    for row in crossovers(results):
        out.print(describe_crossover(row), soft_wrap=True)
    for work_row in work_crossovers(results):
        out.print(describe_work_crossover(work_row), soft_wrap=True)


def caution_lines(model_results: ModelResults) -> list[str | Text]:
    """Return `cautions` as lines in yellow."""
    return [Text(text, style="yellow") for text in cautions(model_results)]


def heading(model: ModelRecord) -> Text:
    """Return the name of a model with the sizes of its comparison, or with why it failed."""
    detail = model.detail.removeprefix(f"{model.model}: ")
    if model.facts is None or model.work is None:
        status = "" if model.status == Status.INPUT else f"{model.status}: "
        return tables.headed(model.model, f": {status}{detail}")
    simulations = tables.count_of(model.nbatch or 0, "simulation")
    sizes = f": {simulations} × {tables.count_of(model.nstep or 0, 'step')}"
    if model.hold and model.hold > 1:
        sizes += f", each control held {model.hold} steps (frame_skip {model.hold})"
    if model.returns:
        sizes += f", returns {_RETURNS[model.returns]}"
    if model.reduced:
        sizes += " (reduced to keep a block short; --nbatch and --nstep set them)"
    if model.status not in (Status.OK, Status.INTERRUPTED):
        sizes += f"; {model.status}: {detail}"
    return tables.headed(model.model, sizes)


def detail_lines(model: ModelRecord) -> list[str]:
    """Return what a model's steps did, its starts, and what MuJoCo warned of."""
    if model.facts is None or model.work is None:
        return []
    work = model.work
    actuators = "" if model.facts.nu else ", no actuators"
    lines = [
        f"nv {model.facts.nv}, {model.facts.integrator}, {model.facts.solver}{actuators}; per step"
        f" {work.contacts:.1f} contacts ({model.start_contacts or 0} at the start),"
        f" {work.constraints:.1f} constraints, {work.solver_iterations:.1f} solver iterations",
    ]
    if model.spread is not None and model.spread != 1.0:
        lines.append(
            f"The spread of starts and controls is scaled by {model.spread:g}:"
            " with more, most simulations diverge"
        )
    lines += starts_lines(model.starts, with_warnings=False)
    if model.diverged:
        diverged = tables.count_of(model.diverged, "simulation")
        lines.append(f"{diverged} diverged, left out of all figures ({model.divergence})")
    lines += tables.warning_lines(model.warnings)
    if model.warnings:
        lines.append("mujoco.rollout and Batch.rollout stop a simulation at its first warning")
    return lines


_RETURNS = {
    Product.FINAL: "final states",
    Product.TRAJECTORY: "the state after every step",
    Product.SENSORS: "state and sensor data of every step",
}


def path_table(sizes: Sequence[ModelResults]) -> Table:
    """Return the table of the paths on one model, at each of its sizes.

    Advised paths have a mark (see `marks`). Whether paths agree is a column where one does not.
    """
    has_sizes, all_agree = len(sizes) > 1, not any(map(_unlike, sizes))
    headings = ["", "path", *(["simulations"] if has_sizes else [])]
    table = tables.plain_table(
        [
            *headings,
            *("ns/step", "speed-up", "95 %", "× real", "loop"),
            *([] if all_agree else ["agrees"]),
        ],
        right=range(2, len(headings) + 4),
        wrapped=[1],
    )
    for model_results in sizes:
        of_paths = marks(model_results)
        for result in _shown(model_results):
            table.add_row(
                of_paths.get(str(result.variant), ""),
                str(result.variant),
                *([f"{result.nbatch:,}" if result.nbatch else ""] if has_sizes else []),
                *_speed_cells(result),
                Loop.CLOSED if result.closed_loop else Loop.OPEN,
                *([] if all_agree else [agrees(result)]),
            )
    return table


def _shown(model_results: ModelResults) -> list[PathResult]:
    """Return the results that have a row: what is unavailable here, or not begun, has none."""
    return [
        result
        for result in model_results.results
        if not (_is_unavailable(result) or _is_pending(result))
    ]


def _unlike(model_results: ModelResults) -> list[PathResult]:
    """Return the results in the table that do not agree, or whose agreement is not known."""
    return [result for result in _shown(model_results) if agrees(result) != _AGREES]


def _speed_cells(result: PathResult) -> list[str]:
    if result.step_ns is None or result.speedup is None:
        return [""] * 4
    return [
        f"{result.step_ns:,.0f}",
        tables.factor(result.speedup.estimate),
        tables.ends(result.speedup) if result.path != BASE or result.options else "",
        _times_real_time(result.realtime_factor),
    ]


def _is_pending(result: PathResult) -> bool:
    return result.status == Status.INTERRUPTED and result.agrees is None


def _times_real_time(factor: float | None) -> str:
    if factor is None:
        return ""
    return f"{factor:,.0f}" if factor >= 10 else tables.plain(factor, 2)


def _is_unavailable(result: PathResult) -> bool:
    return result.status == Status.UNAVAILABLE


_AGREES = "yes"


def agrees(result: PathResult) -> str:
    """Return whether a path agrees, or why that is not known, in a few words."""
    if result.status == Status.OK:
        return _AGREES if result.is_judged else "not judged"
    return "NO" if result.status == Status.DISAGREES else str(result.status)


def _compile_table(results: Sequence[PathResult]) -> Table:
    """Return what compiling cost, and after how many steps of the plain loop it breaks even."""
    table = tables.plain_table(
        ["compiled", "precision", "device", "trace s", "compile s", "cached s", "steady ns/step",
         "memory", "break-even"],
        right=range(3, 8),
    )  # fmt: skip
    for result in results:
        if result.compile_s is None:
            continue
        table.add_row(
            *([result.path, result.precision or "", result.device or ""]),
            "" if result.trace_s is None else f"{result.trace_s:.1f}",
            f"{result.compile_s:.1f}",
            "" if result.cached_compile_s is None else f"{result.cached_compile_s:.1f}",
            f"{result.step_ns:,.0f}" if result.step_ns else "",
            _memory(result),
            _break_even(result),
        )
    return table


def _break_even(result: PathResult) -> str:
    if result.step_ns is None or result.speedup is None:
        return ""
    if result.overtakes_after_steps is None:
        return "never: the plain loop is faster"
    return f"after {result.overtakes_after_steps:,.0f} steps"


def _memory(result: PathResult) -> str:
    """Return the most memory that the process had, and that of the GPU."""
    sizes = {"": result.memory_bytes, "GPU ": result.gpu_memory_bytes}
    return ", ".join(f"{kind}{n / 2**20:,.0f} MiB" for kind, n in sizes.items() if n)


def notes(model_results: ModelResults) -> list[str | Text]:
    """Return what a reader of the table must know: reasons, and how many cores there were."""
    model, results = model_results.model, model_results.results
    lines = [
        f"{Variant(r.path, r.options)}: {r.status}: {r.detail}"
        for r in results
        if r.detail
        and not _is_unavailable(r)
        and (r.status, r.detail) != (model.status, model.detail)
    ]
    lines += _unavailable_lines(results)
    lines += [f"{r.path}: {r.agreement}" for r in results if r.check and r.agrees]
    lines += [
        f"{r.path}: timed in one process, so its speed-up has no interval"
        for r in results
        if r.is_accelerated and r.is_timed
    ]
    lines += _buffer_lines(results)
    lines += _error_causes(results)
    return [*_race_notes(model_results), *lines, *_cores_note(model_results)]


def _race_notes(model_results: ModelResults) -> list[str]:
    """Return whether all paths agree, what its advice implies, and how the race ended."""
    lines = []
    if model_results.model.status == Status.OK and not _unlike(model_results):
        lines.append("All paths agree with the plain loop.")
    if advise_clock(model_results) is not None:
        lines.append(package_timer.OFF_NOTE)
    race = model_results.race
    if race is not None and race.status not in (Status.OK, Status.INTERRUPTED):
        lines.append(f"The race ended early: {race.status}: {race.detail}")
    if race is not None and race.is_cut_short and race.status == Status.OK:
        count = len(race.launches)
        lines.append(
            f"The budget ended the race after {count} {'launch' if count == 1 else 'launches'}:"
            f" --budget {_longer_budget_s(race)} makes it more certain."
        )
    return lines


def _longer_budget_s(race: RaceRecord) -> int:
    """Return a budget, in whole minutes, in which a race can have several times the launches."""
    timed_s = 1e-9 * sum(sum(row) for launch in race.launches for row in launch.ns)
    return max(_LONGER_BUDGET_S, 60 * math.ceil(_LONGER * timed_s / 60))


def _buffer_lines(results: Sequence[PathResult]) -> list[str]:
    """Return sizes of buffers that sufficed, to paste into a call of make_data."""
    return [
        f"{result.path}: {keyword_arguments(result.buffer_sizes).removeprefix(', ')} suffice for"
        f" {result.nbatch} simulations like these: twice what this run needed at most"
        for result in results
        if result.buffer_sizes and result.agrees
    ]


def _cores_note(model_results: ModelResults) -> list[str | Text]:
    """Return how many cores threads had; where they had too few, the heading says so."""
    if model_results.cores is None or model_results.disturbances:
        return []
    return [f"Threads had {model_results.cores} (calibration)."]


def _error_causes(results: Sequence[PathResult]) -> list[str]:
    """Return why MJX differs from C, where checks in float32 and float64 can say."""
    checks = {r.precision: r.check for r in results if r.path in ("mjx", "mjx64") and r.check}
    coarse, fine = checks.get(Precision.FLOAT32), checks.get(Precision.FLOAT64)
    if coarse is None or fine is None:
        return []
    return [f"MJX differs from C because of {accelerated_limits.error_cause(coarse, fine)}"]


def _unavailable_lines(results: Sequence[PathResult]) -> list[str]:
    """Return why some paths were not compared, a line for each reason."""
    paths_by_reason: dict[str, list[str]] = {}
    for result in filter(_is_unavailable, results):
        names = paths_by_reason.setdefault(result.detail, [])
        if result.path not in names:
            names.append(result.path)
    return [
        f"Not compared: {', '.join(names)}: {reason}" for reason, names in paths_by_reason.items()
    ]


def _print_code(out: Console, all_advice: Sequence[Advice]) -> None:
    """Print the Python of the paths that are advised, each once."""
    for snippet in dict.fromkeys(advice.snippet for advice in all_advice):
        loops = [f"{advice.loop} loop" for advice in all_advice if advice.snippet == snippet]
        path = next(str(Variant(a.path, a.options)) for a in all_advice if a.snippet == snippet)
        print_snippet(out, path, snippet, f" ({' and '.join(loops)})")


def print_snippet(out: Console, path: str, snippet: str, note: str = "") -> None:
    """Print the Python of a path, indented, below its name."""
    out.print()
    out.print(tables.headed(path, f"{note}:"), soft_wrap=True)
    for line in snippet.splitlines():
        out.print(f"    {line}", soft_wrap=True)
