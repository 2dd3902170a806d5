"""Tables and lines for a terminal, or for a file when there is no terminal."""

from collections.abc import Mapping, Sequence
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from mjbench.instrument.runs import Record
from mjbench.paths import nthread
from mjbench.report import results as derive
from mjbench.simulation import accelerated_check

# Below this share of the usable cores, threaded figures say more about the machine's other
# guests than about the paths.
POOR_CORES = 0.85
_PLAIN_WIDTH, _LEAST_WIDTH = 160, 116


class _Console(Console):
    """A console that ends the command with exit code 3 when nobody reads on (`… | head`)."""

    def on_broken_pipe(self) -> None:
        try:
            super().on_broken_pipe()
        except SystemExit:
            raise SystemExit(3) from None


def console(stderr: bool = False) -> Console:
    """Return a console that never squeezes a table: long lines are the terminal's to wrap."""
    made = _Console(stderr=stderr, highlight=False)
    made.width = max(made.width, _LEAST_WIDTH) if made.is_terminal else _PLAIN_WIDTH
    return made


def options_text(options: Mapping[str, Any]) -> str:
    """Return options as people write them, such as `threads=2 pool=kept`."""
    return " ".join(f"{name}={value}" for name, value in options.items())


def model_report(out: Console, records: Sequence[Record]) -> list[Record]:
    """Print one model's heading, table, warnings and advice; return its results."""
    head = next(r for r in records if r["type"] == "model")
    results = derive.of_model(records)
    out.print()
    for line in _heading(head):
        out.print(line, soft_wrap=True)
    if head["status"] != "ok" and not any(r["step_ns"] or r["agrees"] is False for r in results):
        return results
    out.print(_table(results))
    if any(r.get("compile_s") is not None for r in results):
        out.print(_compiled_table(results))
    for line in _notes(head, results):
        out.print(line, soft_wrap=True)
    for entry in derive.advice(results):
        _print_advice(out, entry)
    return results


def print_models(out: Console, rows: Sequence[Record]) -> None:
    """Print the table of `mjbench models`, and below it a line for each model that failed."""
    columns = ("nq", "nv", "nu", "na", "contacts", "constraints")
    table = plain_table(["model", *columns, "timestep", "integrator", "solver"], right=range(1, 8))
    good = [row for row in rows if row["status"] == "ok"]
    for row in good:
        cells = [row["model"], *(str(row[c]) for c in columns), f"{1e3 * row['timestep']:g} ms"]
        table.add_row(*map(escape, cells), row["integrator"], row["solver"])
    if good:
        out.print(table)
    for row in rows:
        if row["status"] != "ok":
            reason = _without(row["detail"], row["model"])
            out.print(f"{escape(row['model'])}: {escape(reason)}", soft_wrap=True)


def releases_table(rows: Sequence[Record]) -> Table:
    """Return the table of `mjbench releases`."""
    table = plain_table(["release", "uploaded (UTC)", "on the index", "in the history", "here"])
    for row in rows:
        table.add_row(
            row["version"],
            (row["uploaded"] or "unknown")[:10],
            "not asked" if row["in_index"] is None else _yes(row["in_index"]),
            _yes(row["in_history"]),
            "installed" if row["installed"] else "",
        )
    return table


def paths_table(rows: Sequence[Record]) -> Table:
    """Return the table of `mjbench paths`."""
    table = plain_table(["path", "closed loop", "here", "what it is", "options"])
    for row in rows:
        table.add_row(
            row["path"],
            _yes(row["closed_loop"]),
            escape(row["unavailable"] or "yes"),
            escape(row["summary"]),
            escape(", ".join(row["options"])),
        )
    return table


def _heading(head: Record) -> list[str]:
    name = f"[bold]{escape(head['model'])}[/bold]"
    if "facts" not in head:
        return [f"{name}: {head['status']}: {escape(_without(head['detail'], head['model']))}"]
    facts, work = head["facts"], head["work"]
    lines = [
        f"{name}: {head['nbatch']} simulations × {head['nstep']} steps"
        + (f", each control held {head['hold']} steps" if head["hold"] > 1 else "")
        + (
            " (reduced to keep a block short; --nbatch and --nstep set them)"
            if head["reduced"]
            else ""
        ),
        f"nv {facts['nv']}, {facts['integrator']}, {facts['solver']}; per step"
        f" {work['contacts']:.1f} contacts, {work['constraints']:.1f} constraints,"
        f" {work['solver_iterations']:.1f} solver iterations",
    ]
    if head["spread"] != 1.0:
        lines.append(
            f"Starts and controls are spread {head['spread']:g} times as wide as usual:"
            " wider, most simulations diverge"
        )
    if head["diverged"]:
        lines.append(
            f"{head['diverged']} simulations diverged and are left out ({head['divergence']})"
        )
    if head["status"] not in ("ok", "interrupted"):
        lines.append(f"{head['status']}: {escape(_without(head['detail'], head['model']))}")
    return lines


def _without(text: str, name: str) -> str:
    return text.removeprefix(f"{name}: ")


def _table(results: Sequence[Record]) -> Table:
    table = plain_table(
        ["path", "options", "steps/s", "ns/step", "min", "speed-up", "95 %", "× real time",
         "loop", "agrees"],
        right=range(2, 8),
    )  # fmt: skip
    for r in results:
        loop = "closed" if r["closed_loop"] else "open"
        cells = [r["path"], options_text(r["options"]), *_speed_cells(r), loop, _agrees(r)]
        table.add_row(*map(escape, cells))
    return table


def _compiled_table(results: Sequence[Record]) -> Table:
    """Return what compiling cost, and after how many steps of the plain loop it has paid."""
    table = plain_table(
        ["compiled", "precision", "device", "trace s", "compile s", "steady ns/step", "memory",
         "pays after"],
        right=range(3, 7),
    )  # fmt: skip
    for r in results:
        if r.get("compile_s") is None:
            continue
        pays = ""
        if r["step_ns"]:
            steps = r["overtakes_after_steps"]
            never = "never: the plain loop is faster" if r["speedup"] else ""
            pays = f"{steps:,.0f} steps" if steps else never
        table.add_row(
            *map(escape, [r["path"], r["precision"], r["device"]]),
            "" if r["trace_s"] is None else f"{r['trace_s']:.1f}",
            f"{r['compile_s']:.1f}",
            f"{r['step_ns']['median']:,.0f}" if r["step_ns"] else "",
            _memory(r),
            pays,
        )
    return table


def _memory(result: Record) -> str:
    """Return the most memory that the process had, and that of the GPU."""
    kinds = {"": result["memory_bytes"], "GPU ": result.get("gpu_memory_bytes")}
    return ", ".join(f"{kind}{n / 2**20:,.0f} MiB" for kind, n in kinds.items() if n)


def print_crossovers(out: Console, results: Sequence[Record]) -> None:
    """Print from which batch size on compiled paths overtake C."""
    for found in derive.crossovers(results):
        who = f"{found['path']} {options_text(found['options'])}".strip()
        rival = f"{found['rival']['path']} {options_text(found['rival']['options'])}".strip()
        if found["nbatch"]:
            text = f"overtakes the best C path ({rival}) at {found['nbatch']:,} simulations"
        else:
            text = (
                f"overtakes the best C path ({rival}): none up to {found['largest']:,} simulations"
                f", where it has {found['share']:.2g} of its speed"
            )
        out.print(f"{escape(found['model'])}: {escape(who)} {escape(text)}", soft_wrap=True)


def differences_table(rows: Sequence[Record]) -> Table:
    """Return the table of `mjbench diff`."""
    table = plain_table(
        ["model", "path", "options", "simulations", "new / old", "95 %", ""], right=(3, 4)
    )
    for r in rows:
        ratio, interval = r["ratio"], ""
        if ratio and ratio["low"] is not None:
            interval = f"{ratio['low']:.3f}–{ratio['high']:.3f}"
        cells = [r["model"], r["path"], options_text(r["options"]), f"{r['nbatch']:,}"]
        cells += [f"{ratio['estimate']:.3f}" if ratio else "", interval, r["detail"]]
        table.add_row(*map(escape, cells))
    return table


def _speed_cells(result: Record) -> list[str]:
    step, speedup = result["step_ns"], result["speedup"]
    if not step:
        return [""] * 6
    interval, factor = "", ""
    if speedup:
        factor = _factor(speedup["median"])
        if speedup["low"] is not None:
            interval = f"{_factor(speedup['low'])}–{_factor(speedup['high'])}"
    realtime = result["realtime_factor"]
    return [
        f"{result['steps_per_s']:,.0f}",
        f"{step['median']:,.0f}",
        f"{step['min']:,.0f}",
        factor,
        interval,
        f"{realtime:,.0f}" if realtime and realtime >= 10 else f"{realtime:.2g}",
    ]


def _factor(ratio: float) -> str:
    return f"{ratio:.2f}" if ratio >= 0.1 else f"{ratio:.1g}"


def _agrees(result: Record) -> str:
    if result["status"] == "ok" and not derive.judged(result):
        return "not judged"
    words = {"ok": "yes", "disagrees": "NO"}
    return words.get(result["status"], str(result["status"]))


def _notes(head: Record, results: Sequence[Record]) -> list[str]:
    """Return what a reader of the table must know: reasons, and what cores there were."""
    lines = [
        f"{r['path']} {options_text(r['options'])}".strip() + f": {r['status']}: {r['detail']}"
        for r in results
        if r["detail"] and (r["status"], r["detail"]) != (head["status"], head["detail"])
    ]
    lines += [f"{r['path']}: {r['agreement']}" for r in results if r.get("check") and r["agrees"]]
    lines += _causes(results)
    notes = [escape(line) for line in lines]
    had, usable = derive.cores_had(head), head["usable_cores"]
    if had is None or not any(r["step_ns"] and _threaded(r) for r in results):
        return notes
    text = f"Threads had {had:.2f} of {usable} usable cores in this run (calibration)."
    if had < POOR_CORES * usable:
        text = f"[yellow]Warning: {text} Threaded figures are low by about as much.[/yellow]"
    return [*notes, text]


def _causes(results: Sequence[Record]) -> list[str]:
    """Return why engines stray, where float32 and float64 can tell."""
    known = [r for r in results if r["path"] in ("mjx", "mjx64") and r.get("check")]
    checks = {r["precision"]: r for r in known}
    if "float32" not in checks or "float64" not in checks:
        return []
    cause = accelerated_check.error_cause(checks["float32"]["check"], checks["float64"]["check"])
    return [f"MJX strays from C by {cause}"]


def _threaded(result: Record) -> bool:
    options = result["options"]
    return nthread(options) > 1


def _print_advice(out: Console, entry: Record) -> None:
    what = f"{entry['path']} {options_text(entry['options'])}".strip()
    gain = f", {_factor(entry['speedup'])}× the plain loop" if entry["speedup"] else ""
    loop = "Open loop" if entry["loop"] == "open" else "Closed loop (a policy chooses controls)"
    out.print(f"[bold]{loop}: {escape(what)}[/bold]{gain}", soft_wrap=True)
    for line in entry["snippet"].splitlines():
        out.print(f"    {escape(line)}", soft_wrap=True)


def plain_table(headings: Sequence[str], right: Sequence[int] | range = ()) -> Table:
    """Return an empty table without frames; the columns numbered in `right` are aligned so."""
    table = Table(box=None, pad_edge=False, header_style="bold")
    for i, heading in enumerate(headings):
        last = i == len(headings) - 1
        table.add_column(
            heading,
            justify="right" if i in right else "left",
            no_wrap=not last,
            overflow="fold",
        )
    return table


def _yes(value: bool) -> str:
    return "yes" if value else "no"
