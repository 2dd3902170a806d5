"""Tables of instruction counts, and of what explains the difference of two."""

from collections.abc import Mapping, Sequence

from rich.console import Console
from rich.markup import escape

from mjbench.counts import explain
from mjbench.counts.instructions import Count
from mjbench.paired.verdict import PairedResult
from mjbench.report import tables


def print_counts(out: Console, counts: Sequence[Count], top: int) -> None:
    """Print instructions per step of every model and release, then functions and stages."""
    headings = ["model", "release", "instructions/step", "outside the engine/step", ""]
    table = tables.plain_table(headings, right=(2, 3))
    for count in counts:
        table.add_row(
            escape(count.model),
            count.release,
            _number(count.instructions_per_step),
            _number(count.outside_per_step),
            escape(count.detail),
        )
    out.print(table)
    for count in counts:
        if count.status != "ok" or not count.instructions_per_step:
            continue
        out.print(f"\n{escape(count.model)}, MuJoCo {count.release}")
        out.print(_shares(count.stages or {}, count.instructions_per_step), soft_wrap=True)
        functions = tables.plain_table(["function", "self/step", "share", "inclusive"], (1, 2, 3))
        for one in count.functions[:top]:
            share = f"{100 * one.self / count.instructions_per_step:.1f} %"
            functions.add_row(escape(one.name), f"{one.self:,.0f}", share, f"{one.inclusive:,.0f}")
        out.print(functions)


def print_explanation(
    out: Console, old: Count, new: Count, outcome: PairedResult | None, top: int
) -> None:
    """Print what changed from one release to another on one model."""
    out.print(f"\n[bold]{escape(new.model)}[/bold], MuJoCo {old.release} → {new.release}")
    for count in (old, new):
        if count.status != "ok":
            out.print(escape(f"MuJoCo {count.release}: {count.detail}"), soft_wrap=True)
            return
    for line in explain.sentence(old, new, outcome):
        out.print(escape(line), soft_wrap=True)
    whole = new.instructions_per_step or 1.0
    before, after = old.stages or {}, new.stages or {}
    table = tables.plain_table(["stage", "old/step", "new/step", "difference"], (1, 2, 3))
    for stage in sorted(after, key=lambda s: -abs(after[s] - before.get(s, 0.0))):
        was, now = before.get(stage, 0.0), after[stage]
        if was or now:
            table.add_row(stage, _number(was), _number(now), f"{now - was:+,.0f}")
    out.print(table)
    functions = tables.plain_table(
        ["function", "old/step", "new/step", "difference", ""], (1, 2, 3)
    )
    changes = explain.changes(old, new)
    for change in changes[:top]:
        functions.add_row(
            escape(change.name),
            _number(change.old),
            _number(change.new),
            f"{change.difference:+,.0f}",
            change.kind,
        )
    out.print(functions)
    rest = sum(change.difference for change in changes[top:])
    if changes[top:]:
        share = 100 * rest / whole
        out.print(f"{len(changes) - top} further functions: {rest:+,.0f} ({share:+.2f} %)")


def _shares(stages: Mapping[str, float], whole: float) -> str:
    ordered = sorted(stages.items(), key=lambda item: -item[1])
    return ", ".join(f"{name} {100 * cost / whole:.1f} %" for name, cost in ordered if cost)


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:,.0f}"
