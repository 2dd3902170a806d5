"""The output of `mjbench compare`: heading, table, notes and advice of each model."""

import statistics
from collections.abc import Sequence

from rich.console import Console
from rich.table import Table
from rich.text import Text

from mjbench.comparison.plan import Variant, describe_options
from mjbench.comparison.records import ModelRecord
from mjbench.paths.accelerated import keyword_arguments
from mjbench.paths.parallelism import nthread
from mjbench.report import tables
from mjbench.report.advice import Advice, ClockAdvice, Loop, Reason, advise, advise_clock
from mjbench.report.crossovers import Crossover, crossovers
from mjbench.report.results import ModelResults, PathResult
from mjbench.report.run_differences import RunDifference
from mjbench.report.starts import starts_lines
from mjbench.report.work_crossovers import CallWork, WorkCrossover, work_crossovers
from mjbench.simulation import accelerated_limits, package_timer
from mjbench.simulation.accelerated_limits import Precision
from mjbench.simulation.workload import Product
from mjbench.status import Status

# Below this share of the usable cores, threaded figures say more about the machine's other
# guests than about the paths.
POOR_CORES = 0.85


# A model on whose free bodies gravity acts falls where it has fewer contacts than this in a step.
_FALLING_CONTACTS = 0.05
_FALLING = (
    "Warning: a free body falls, and touches nothing: these are the speeds of free fall. Let it"
    " settle (--settle 3s), or give states of your own (--states)."
)


def print_model(out: Console, model_results: ModelResults, code: bool = False) -> None:
    """Print one model's heading, table, warnings and advice.

    Args:
      code: whether to print the Python of the paths that are advised.
    """
    model, results = model_results.model, model_results.results
    out.print()
    for line in heading_lines(model):
        out.print(line, soft_wrap=True)
    if model.status != Status.OK and not any(r.step_ns or r.agrees is False for r in results):
        return
    shown = [result for result in results if not _is_unavailable(result)]
    out.print(_path_table(shown))
    if any(result.compile_s is not None for result in shown):
        out.print(_compile_table(shown))
    for line in notes(model_results):
        out.print(line, soft_wrap=True)
    all_advice = advise(model_results)
    clock = advise_clock(model_results)
    if clock is not None:
        _print_clock(out, clock, results)
    for advice in all_advice:
        _print_advice(out, advice)
    if code:
        _print_code(out, all_advice)


def print_models(out: Console, models: Sequence[ModelResults], code: bool = False) -> None:
    """Print what comparisons of models come to, one after the other and together.

    Args:
      models: in the order they were measured.
      code: whether to print the Python of the paths that are advised.
    """
    for model_results in models:
        print_model(out, model_results, code)
    print_crossovers(out, models)
    if len(models) > 1:
        print_summary(out, models)


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
        interval = (
            f"{tables.factor(row.low)}–{tables.factor(row.high)}" if row.low and row.high else ""
        )
        table.add_row(
            names[row.model],
            *size,
            row.loop,
            str(Variant(row.path, row.options)),
            tables.factor(row.speedup) if row.speedup else "1",
            interval,
            _times_real_time(row.realtime_factor),
        )
    out.print()
    out.print(tables.headed("Advice", " (speed-ups over the plain loop, in fresh processes)"))
    out.print(table)


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


def describe_crossover(row: Crossover) -> str:
    """Return from which batch size on an accelerated path overtakes C, as a sentence."""
    variant = str(Variant(row.path, row.options))
    rival = str(Variant(row.rival.path, row.rival.options))
    if row.nbatch:
        text = f"overtakes the best C path ({rival}) at {row.nbatch:,} simulations of those tried"
        text += _curve_crossing(row)
    else:
        text = (
            f"does not overtake the best C path ({rival}) up to {row.largest:,} simulations,"
            f" where it has {tables.plain(row.share, 2)} of its speed"
        )
    return f"{row.model}: {variant} {text}"


def describe_work_crossover(row: WorkCrossover) -> str:
    """Return from how much work per call on Ray overtakes another path, as a sentence."""
    variant = str(Variant(row.path, row.options))
    rival = str(Variant(row.rival.path, row.rival.options))
    if row.least:
        return (
            f"{row.model}: {variant} overtakes {rival} at {_call_work(row.least)}, of those tried"
        )
    text = (
        f"{row.model}: {variant} does not overtake {rival} up to {_call_work(row.largest)}, where"
        f" it has {tables.factor(row.share)} of its speed"
    )
    if row.rival.path == "rollout" and nthread(row.rival.options) > 1:
        text += "; on one machine, rollout needs no Ray to use all cores"
    return text


def _call_work(work: CallWork) -> str:
    return f"{work.steps:,} steps per call ({tables.plain(work.loop_ms, 2)} ms of the plain loop)"


def _curve_crossing(row: Crossover) -> str:
    """Return where the curve through all sizes crosses, with its interval; empty without one."""
    curve = row.curve
    if curve is None or curve.nbatch is None:
        return ""
    low = "fewer than all" if curve.low is None else f"{curve.low:,.0f}"
    high = "more than all" if curve.high is None else f"{curve.high:,.0f}"
    return f"; a curve through all sizes crosses at {curve.nbatch:,.0f} (95 %: {low} to {high})"


def differences_table(rows: Sequence[RunDifference]) -> Table:
    """Return the table of `mjbench diff`; of sets, with a column for the machine."""
    machines = ["machine"] if any(row.machine for row in rows) else []
    headings = [*machines, "model", "path", "options", "simulations", "new / old", "95 %", ""]
    table = tables.plain_table(headings, right=(3 + len(machines), 4 + len(machines)))
    for row in rows:
        interval = ""
        if row.ratio and row.ratio.low is not None:
            interval = f"{row.ratio.low:.3f}–{row.ratio.high:.3f}"
        table.add_row(
            *([row.machine] if machines else []),
            row.model,
            row.path,
            describe_options(row.options),
            "" if row.nbatch is None else f"{row.nbatch:,}",
            f"{row.ratio.estimate:.3f}" if row.ratio else "",
            interval,
            row.detail,
        )
    return table


def heading_lines(model: ModelRecord) -> list[str | Text]:
    """Return what stands above the table of a model: its sizes, what its steps did, its starts."""
    detail = model.detail.removeprefix(f"{model.model}: ")
    if model.facts is None or model.work is None:
        status = "" if model.status == Status.INPUT else f"{model.status}: "
        return [tables.headed(model.model, f": {status}{detail}")]
    simulations = tables.count_of(model.nbatch or 0, "simulation")
    sizes = f": {simulations} × {tables.count_of(model.nstep or 0, 'step')}"
    if model.hold and model.hold > 1:
        sizes += f", each control held {model.hold} steps (frame_skip {model.hold})"
    if model.returns:
        sizes += f", returns {_RETURNS[model.returns]}"
    if model.reduced:
        sizes += " (reduced to keep a block short; --nbatch and --nstep set them)"
    work = model.work
    actuators = "" if model.facts.nu else ", no actuators"
    lines: list[str | Text] = [
        tables.headed(model.model, sizes),
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
    if model.facts.can_fall and not model.start_contacts and work.contacts < _FALLING_CONTACTS:
        lines.append(Text(_FALLING, style="yellow"))
    if model.diverged:
        diverged = tables.count_of(model.diverged, "simulation")
        lines.append(f"{diverged} diverged, left out of all figures ({model.divergence})")
    lines += tables.warning_lines(model.warnings)
    if model.warnings:
        lines.append("mujoco.rollout and Batch.rollout stop a simulation at its first warning")
    if model.status not in (Status.OK, Status.INTERRUPTED):
        lines.append(f"{model.status}: {detail}")
    return lines


_RETURNS = {
    Product.FINAL: "final states",
    Product.TRAJECTORY: "the state after every step",
    Product.SENSORS: "state and sensor data of every step",
}


def _path_table(results: Sequence[PathResult]) -> Table:
    table = tables.plain_table(
        ["path", "ns/step", "speed-up", "× real", "loop", "agrees"], right=range(1, 4)
    )
    for result in results:
        table.add_row(
            str(Variant(result.path, result.options)),
            *_speed_cells(result),
            Loop.CLOSED if result.closed_loop else Loop.OPEN,
            agrees(result),
        )
    return table


def _speed_cells(result: PathResult) -> list[str]:
    if result.step_ns is None:
        return [""] * 3
    return [
        f"{result.step_ns.median:,.0f}",
        tables.factor(result.speedup.median) if result.speedup else "",
        _times_real_time(result.realtime_factor),
    ]


def _times_real_time(factor: float | None) -> str:
    if factor is None:
        return ""
    return f"{factor:,.0f}" if factor >= 10 else tables.plain(factor, 2)


def _is_unavailable(result: PathResult) -> bool:
    return result.status == Status.UNAVAILABLE


def agrees(result: PathResult) -> str:
    """Return whether a path agrees, or why that is not known, in a few words."""
    if result.status == Status.OK:
        return "yes" if result.is_judged else "not judged"
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
            f"{result.step_ns.median:,.0f}" if result.step_ns else "",
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
    lines += _buffer_lines(results)
    lines += _error_causes(results)
    return [*lines, *_cores_note(model_results)]


def _buffer_lines(results: Sequence[PathResult]) -> list[str]:
    """Return sizes of buffers that sufficed, to paste into a call of make_data."""
    return [
        f"{result.path}: {keyword_arguments(result.buffer_sizes).removeprefix(', ')} suffice for"
        f" {result.nbatch} simulations like these: twice what this run needed at most"
        for result in results
        if result.buffer_sizes and result.agrees
    ]


def _cores_note(model_results: ModelResults) -> list[str | Text]:
    cores, usable = model_results.cores_had, model_results.model.usable_cores
    is_threaded = any(r.step_ns and nthread(r.options) > 1 for r in model_results.results)
    if cores is None or not is_threaded:
        return []
    text = f"Threads had {cores:.2f} of {usable} usable cores in this run (calibration)."
    if cores < POOR_CORES * usable:
        text = f"Warning: {text} Threaded figures are low by about as much."
        return [Text(text, style="yellow")]
    return [text]


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


def _print_clock(out: Console, clock: ClockAdvice, results: Sequence[PathResult]) -> None:
    low, high = tables.factor(clock.low), tables.factor(clock.high)
    gain = f"{tables.factor(clock.speedup)}× the plain loop ({low} to {high} in fresh processes)"
    heading, code = f"Any path: turn off {package_timer.NAME}", package_timer.OFF_CODE
    out.print(tables.headed(heading, f", {gain}: {code}"), soft_wrap=True)
    out.print(f"  {package_timer.OFF_NOTE}", soft_wrap=True)
    gains = [result.clock_gain for result in results if result.clock_gain is not None]
    if len(gains) > 1:
        gain = tables.factor(statistics.median(gains))
        out.print(
            f"  In this process, {len(gains)} paths gain {gain}× (the median).", soft_wrap=True
        )


_LOOPS = {Loop.OPEN: "Open loop", Loop.CLOSED: "Closed loop"}


def _print_advice(out: Console, advice: Advice) -> None:
    heading = f"{_LOOPS[advice.loop]}: {Variant(advice.path, advice.options)}"
    out.print(tables.headed(heading, f", {why(advice)}"), soft_wrap=True)


def why(advice: Advice) -> str:
    """Return why a path is advised, in a clause."""
    gain = ""
    if advice.speedup:
        gain = f"{tables.factor(advice.speedup)}× the plain loop"
        if advice.low and advice.high:
            low, high = tables.factor(advice.low), tables.factor(advice.high)
            gain += f" ({low} to {high} in fresh processes)"
    match advice.reason:
        case Reason.FASTER | Reason.PAYS:
            text = gain
        case Reason.SIMPLER:
            text = f"{gain + '; ' if gain else ''}{advice.rival} is not faster by 3 %"
        case Reason.NO_GAIN:
            text = "no path is certainly faster"
        case Reason.ALONE:
            text = "no other path was timed for it"
        case Reason.UNCONFIRMED if advice.rival:
            text = f"{advice.rival} seems faster, but was not compared again in fresh processes"
        case Reason.UNCONFIRMED:
            text = "no path seems faster; nothing was compared again in fresh processes"
    if advice.detail:
        text += f": {advice.detail}"
    unable = [f"cannot run beside the others: {each}" for each in advice.unable]
    return "; ".join(filter(None, (text, *unable, advice.break_even)))


def _print_code(out: Console, all_advice: Sequence[Advice]) -> None:
    """Print the Python of the paths that are advised, each once."""
    for snippet in dict.fromkeys(advice.snippet for advice in all_advice):
        loops = [_LOOPS[advice.loop].lower() for advice in all_advice if advice.snippet == snippet]
        path = next(str(Variant(a.path, a.options)) for a in all_advice if a.snippet == snippet)
        print_snippet(out, path, snippet, f" ({' and '.join(loops)})")


def print_snippet(out: Console, path: str, snippet: str, note: str = "") -> None:
    """Print the Python of a path, indented, below its name."""
    out.print()
    out.print(tables.headed(path, f"{note}:"), soft_wrap=True)
    for line in snippet.splitlines():
        out.print(f"    {line}", soft_wrap=True)
