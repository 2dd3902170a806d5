"""The output of `mjbench compare`: heading, table, notes and advice of each model."""

from collections.abc import Sequence

from rich.console import Console
from rich.table import Table
from rich.text import Text

from mjbench.comparison.plan import Variant, describe_options
from mjbench.comparison.records import ModelRecord
from mjbench.paths.parallelism import nthread
from mjbench.report import tables
from mjbench.report.advice import Advice, Loop, advise
from mjbench.report.crossovers import Crossover
from mjbench.report.results import ModelResults, PathResult
from mjbench.report.run_differences import RunDifference
from mjbench.simulation import accelerated_limits
from mjbench.simulation.accelerated_limits import Precision
from mjbench.status import Status

# Below this share of the usable cores, threaded figures say more about the machine's other
# guests than about the paths.
POOR_CORES = 0.85


def print_model(out: Console, model_results: ModelResults) -> None:
    """Print one model's heading, table, warnings and advice."""
    model, results = model_results.model, model_results.results
    out.print()
    for line in _heading(model):
        out.print(line, soft_wrap=True)
    if model.status != Status.OK and not any(r.step_ns or r.agrees is False for r in results):
        return
    out.print(_path_table(results))
    if any(result.compile_s is not None for result in results):
        out.print(_compile_table(results))
    for line in _notes(model_results):
        out.print(line, soft_wrap=True)
    for advice in advise(results):
        _print_advice(out, advice)


def print_crossovers(out: Console, crossovers: Sequence[Crossover]) -> None:
    """Print from which batch size on accelerated paths overtake C."""
    for row in crossovers:
        variant = str(Variant(row.path, row.options))
        rival = str(Variant(row.rival.path, row.rival.options))
        if row.nbatch:
            text = f"overtakes the best C path ({rival}) at {row.nbatch:,} simulations"
        else:
            text = (
                f"does not overtake the best C path ({rival}) up to {row.largest:,} simulations,"
                f" where it has {tables.plain(row.share, 2)} of its speed"
            )
        out.print(f"{row.model}: {variant} {text}", soft_wrap=True)


def differences_table(rows: Sequence[RunDifference]) -> Table:
    """Return the table of `mjbench diff`."""
    table = tables.plain_table(
        ["model", "path", "options", "simulations", "new / old", "95 %", ""], right=(3, 4)
    )
    for row in rows:
        interval = ""
        if row.ratio and row.ratio.low is not None:
            interval = f"{row.ratio.low:.3f}–{row.ratio.high:.3f}"
        table.add_row(
            row.model,
            row.path,
            describe_options(row.options),
            f"{row.nbatch:,}",
            f"{row.ratio.estimate:.3f}" if row.ratio else "",
            interval,
            row.detail,
        )
    return table


def _heading(model: ModelRecord) -> list[str | Text]:
    detail = model.detail.removeprefix(f"{model.model}: ")
    if model.facts is None or model.work is None:
        return [tables.headed(model.model, f": {model.status}: {detail}")]
    sizes = f": {model.nbatch} simulations × {model.nstep} steps"
    if model.hold and model.hold > 1:
        sizes += f", each control held {model.hold} steps"
    if model.reduced:
        sizes += " (reduced to keep a block short; --nbatch and --nstep set them)"
    work = model.work
    lines: list[str | Text] = [
        tables.headed(model.model, sizes),
        f"nv {model.facts.nv}, {model.facts.integrator}, {model.facts.solver}; per step"
        f" {work.contacts:.1f} contacts, {work.constraints:.1f} constraints,"
        f" {work.solver_iterations:.1f} solver iterations",
    ]
    if model.spread is not None and model.spread != 1.0:
        lines.append(
            f"The spread of starts and controls is scaled by {model.spread:g}:"
            " with more, most simulations diverge"
        )
    lines += tables.starts_lines(model.starts)
    if model.diverged:
        lines.append(f"{model.diverged} simulations diverged and are left out ({model.divergence})")
    lines += tables.warning_lines(model.warnings)
    if model.warnings:
        lines.append("mujoco.rollout and Batch.rollout stop a simulation at its first warning")
    if model.status not in (Status.OK, Status.INTERRUPTED):
        lines.append(f"{model.status}: {detail}")
    return lines


def _path_table(results: Sequence[PathResult]) -> Table:
    table = tables.plain_table(
        ["path", "options", "steps/s", "ns/step", "min", "speed-up", "95 %", "× real time",
         "loop", "agrees"],
        right=range(2, 8),
    )  # fmt: skip
    for result in results:
        cells = [
            result.path,
            describe_options(result.options),
            *_speed_cells(result),
            Loop.CLOSED if result.closed_loop else Loop.OPEN,
            _agrees(result),
        ]
        table.add_row(*cells)
    return table


def _speed_cells(result: PathResult) -> list[str]:
    if result.step_ns is None:
        return [""] * 6
    interval, factor = "", ""
    if result.speedup:
        factor = tables.factor(result.speedup.median)
        if result.speedup.low is not None and result.speedup.high is not None:
            low, high = tables.factor(result.speedup.low), tables.factor(result.speedup.high)
            interval = f"{low}–{high}"
    realtime = result.realtime_factor
    if realtime is None:
        simulated = ""
    else:
        simulated = f"{realtime:,.0f}" if realtime >= 10 else tables.plain(realtime, 2)
    return [
        f"{result.steps_per_s:,.0f}",
        f"{result.step_ns.median:,.0f}",
        f"{result.step_ns.min:,.0f}",
        factor,
        interval,
        simulated,
    ]


def _agrees(result: PathResult) -> str:
    if result.status == Status.OK:
        return "yes" if result.is_judged else "not judged"
    return "NO" if result.status == Status.DISAGREES else str(result.status)


def _compile_table(results: Sequence[PathResult]) -> Table:
    """Return what compiling cost, and after how many steps of the plain loop it breaks even."""
    table = tables.plain_table(
        ["compiled", "precision", "device", "trace s", "compile s", "steady ns/step", "memory",
         "break-even"],
        right=range(3, 7),
    )  # fmt: skip
    for result in results:
        if result.compile_s is None:
            continue
        table.add_row(
            *([result.path, result.precision or "", result.device or ""]),
            "" if result.trace_s is None else f"{result.trace_s:.1f}",
            f"{result.compile_s:.1f}",
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


def _notes(model_results: ModelResults) -> list[str | Text]:
    """Return what a reader of the table must know: reasons, and how many cores there were."""
    model, results = model_results.model, model_results.results
    lines = [
        f"{Variant(r.path, r.options)}: {r.status}: {r.detail}"
        for r in results
        if r.detail and (r.status, r.detail) != (model.status, model.detail)
    ]
    lines += [f"{r.path}: {r.agreement}" for r in results if r.check and r.agrees]
    lines += _error_causes(results)
    return [*lines, *_cores_note(model_results)]


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


def _print_advice(out: Console, advice: Advice) -> None:
    variant = str(Variant(advice.path, advice.options))
    gain = f", {tables.factor(advice.speedup)}× the plain loop" if advice.speedup else ""
    loop = "Open loop"
    if advice.loop == Loop.CLOSED:
        loop = "Closed loop (a policy chooses controls)"
    out.print(tables.headed(f"{loop}: {variant}", gain), soft_wrap=True)
    for line in advice.snippet.splitlines():
        out.print(f"    {line}", soft_wrap=True)
