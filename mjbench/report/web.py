"""What `mjbench web` prints: WebAssembly builds beside C, and what experiments with them showed."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from rich.console import Console

from mjbench.comparison.plan import Variant
from mjbench.instrument.stats import Estimate
from mjbench.report import tables
from mjbench.report.starts import starts_lines
from mjbench.report.web_results import WebPathRow, WebRow
from mjbench.status import Status
from mjbench.web.messages import Examined, HeapLimit, ObjectMemory
from mjbench.web.records import C_PATH, Mathematics, WebExperimentsRecord
from mjbench.web.rounding_check import FirstDifference, RoundingCheck

_MIB, _GIB = 1 << 20, 1 << 30
# Below so many milliseconds, a block of C takes visibly longer than its steps.
_SHORT_MS = 1.0


@dataclass(frozen=True)
class WebFinding:
    """What an experiment showed, and the correct JavaScript.

    Attributes:
      builds: that behave so.
      text: what happens, in a sentence or two.
      code: correct JavaScript; empty if there is none to write.
    """

    builds: Sequence[str]
    text: str
    code: str = ""


def print_model(out: Console, row: WebRow) -> None:
    """Print what was measured of a model, the conclusion first."""
    out.print()
    heading, _, text = conclusion(row).partition(": ")
    out.print(tables.headed(heading, f": {text}"), soft_wrap=True)
    if row.work is None:
        return
    out.print(
        f"MuJoCo {row.release}, Node {row.node}; {row.nbatch} × {row.nstep} steps compared,"
        f" {row.block_nbatch} × {row.block_nstep} in a block; {row.work.contacts:.1f} contacts and"
        f" {row.work.constraints:.1f} constraints a step",
        soft_wrap=True,
    )
    for line in starts_lines(row.starts):
        out.print(line, soft_wrap=True)
    headings = (
        *("path", "ns/step", "× C", "", "agrees", "difference"),
        *("start ms", "model ms", "first ns/step", "heap MiB", "process MiB"),
    )
    table = tables.plain_table(headings, right=(1, 2, 5, 6, 7, 8, 9, 10))
    for path in row.paths:
        table.add_row(*_cells(path))
    out.print(table)
    for line in notes(row):
        out.print(line, soft_wrap=True)


def conclusion(row: WebRow) -> str:
    """Return what follows for a model, in one sentence."""
    if row.status != Status.OK:
        return f"{row.model}: {row.status}: {row.detail}"
    wasm = [path for path in row.paths if path.is_wasm]
    if not wasm:
        return f"{row.model}: no build was compared"
    first = next((path for path in wasm if path.status == Status.OK), None)
    if first is None:
        bad = next((path for path in wasm if path.status == Status.DISAGREES), wasm[0])
        return f"{row.model}: {_name(bad)}: {bad.status}: {bad.detail}"
    parts = ["" if first.check is None else _agreement(first.check)]
    if first.ratio is not None:
        name = "WebAssembly" if first is wasm[0] else f"WebAssembly ({_name(first)})"
        times = f"{tables.factor(first.ratio.median)} times as long as in C{_interval(first.ratio)}"
        parts.insert(0, f"in {name}, a step takes {times}")
    if others := [_name(path) for path in wasm if path.status == Status.DISAGREES]:
        verb = "disagrees" if len(others) == 1 else "disagree"
        parts.append(f"{', '.join(others)} {verb} with C")
    return f"{row.model}: {'; '.join(filter(None, parts))}"


def _agreement(check: RoundingCheck) -> str:
    """Return how far a build that agrees is from C, as part of a sentence."""
    if check.first is None:
        return "its states are C's to the last bit"
    if not check.final.difference:
        return f"over {check.nstep} steps its positions, velocities and activations are C's"
    return f"after {check.nstep} steps its states are within {check.final.difference:.1e} of C's"


def notes(row: WebRow) -> list[str]:
    """Return the lines below the table of a model."""
    lines = list(_short_blocks(row))
    checks: dict[str, list[str]] = {}
    for path in row.paths:
        if path.check is not None:
            for line in _check_lines(path.check):
                checks.setdefault(line, []).append(_name(path))
    lines += [f"{', '.join(names)}: {line}" for line, names in checks.items()]
    lines += [
        f"{_name(path)}: {path.status}: {path.detail}"
        for path in row.paths
        if path.status != Status.OK
    ]
    return lines


def _short_blocks(row: WebRow) -> Iterator[str]:
    """Yield a warning if blocks are so short that more than the steps counts."""
    step_ns = next((path.step_ns for path in row.paths if path.path == C_PATH), None)
    if step_ns is None or row.block_nbatch is None or row.block_nstep is None:
        return
    block_ms = 1e-6 * step_ns * row.block_nbatch * row.block_nstep
    if block_ms < _SHORT_MS:
        yield (
            f"A block takes only {block_ms:.2f} ms in C, so setting states and cold caches count,"
            " too. Use a larger --nbatch or --nstep."
        )


def _check_lines(check: RoundingCheck) -> Iterator[str]:
    """Yield where a build first differs from C, and how far its run gets from C's."""
    if check.first is None:
        yield f"identical to C, to the last bit, over {check.nstep} steps"
    else:
        yield f"first differs from C {check.first}{_of_same_model(check)}"
        later = check.points[1:]
        steps = ", ".join(str(point.step) for point in later)
        differences, shadows = (
            ", ".join(_small(value) for value in values)
            for values in (
                [point.difference for point in later],
                [point.shadow for point in later],
            )
        )
        yield f"difference after {steps} steps: {differences}; the shadow's: {shadows}"
    for kind, errors in (
        ("unconstrained", check.unconstrained),
        ("constrained", check.constrained),
    ):
        if errors.count and errors.error:
            yield (
                f"{errors.count} {kind} single steps within {_small(errors.error)}"
                f" (the shadow: {_small(errors.shadow)})"
            )


def _of_same_model(check: RoundingCheck) -> str:
    """Return whether the run of C's compiled model differs, too, as the end of a sentence."""
    if not check.has_same_model:
        return ""
    if check.first_of_same_model is None:
        return "; with the model that C compiled, it does not: only the compiled model differs"
    if _place(check.first_of_same_model) == _place(check.first):
        return "; also with the model that C compiled"
    return f"; with the model that C compiled, {check.first_of_same_model}"


def _place(first: FirstDifference | None) -> tuple[int, str, int] | None:
    return None if first is None else (first.step, first.field, first.index)


def _cells(path: WebPathRow) -> Iterator[str]:
    """Yield the cells of a path's row."""
    yield _name(path)
    yield "" if path.step_ns is None else f"{path.step_ns:,.0f}"
    yield "" if path.ratio is None else tables.factor(path.ratio.median)
    yield "" if path.ratio is None or not path.is_wasm else _interval(path.ratio).strip()
    if path.check is None:
        yield "" if path.status == Status.OK else str(path.status)
        yield ""
    else:
        identical = "identical" if path.check.first is None else "yes"
        yield "NO" if path.status == Status.DISAGREES else identical
        yield _small(path.check.final.difference)
    if path.start_up is None:
        yield from ("", "", "")
    else:
        yield f"{path.start_up.import_ms + path.start_up.instantiate_ms:,.0f}"
        yield f"{path.start_up.compile_ms:,.0f}"
        yield f"{path.start_up.first_ns:,.0f}"
    for size in (path.heap_bytes, path.rss_bytes):
        yield "" if size is None else f"{size / _MIB:,.0f}"


def _name(path: WebPathRow) -> str:
    return str(Variant(path.path, path.options))


def _interval(ratio: Estimate) -> str:
    if ratio.low is None or ratio.high is None:
        return ""
    return f" ({tables.factor(ratio.low)} to {tables.factor(ratio.high)})"


def _small(value: float) -> str:
    return "0" if value == 0 else f"{value:.1e}"


def print_findings(out: Console, records: Sequence[WebExperimentsRecord]) -> None:
    """Print what experiments with builds showed."""
    shown = findings(records)
    if shown:
        out.print(tables.headed("\nExperiments with the builds", ", on memory and mathematics:"))
    for finding in shown:
        out.print(f"{', '.join(finding.builds)}: {finding.text}", soft_wrap=True)
        if finding.code:
            out.print(f"    {finding.code}", soft_wrap=True)
    for record in records:
        if record.status not in (Status.OK, Status.INTERRUPTED):
            out.print(f"{record.build}: {record.status}: {record.detail}", soft_wrap=True)


def findings(records: Sequence[WebExperimentsRecord]) -> list[WebFinding]:
    """Return what experiments showed, each once for all builds that behave alike."""
    builds: dict[tuple[str, str], list[str]] = {}
    for record in records:
        shown = [] if record.examined is None else list(_shown(record.examined))
        if record.limits:
            shown.append(_limit(record.limits))
        if record.mathematics is not None:
            shown.append((_mathematics(record.mathematics), ""))
        for each in shown:
            builds.setdefault(each, []).append(record.build.value)
    return [WebFinding(names, text, code) for (text, code), names in builds.items()]


def _shown(examined: Examined) -> Iterator[tuple[str, str]]:
    """Yield what experiments showed, and the correct JavaScript."""
    yield _growth(examined)
    snapshot = examined.snapshot
    if snapshot.views_range_m < snapshot.copies_range_m:
        yield (
            f"A view is not a snapshot: over {snapshot.nstep} steps of the falling cart-pole, the"
            f" tip's x ranges over {snapshot.copies_range_m:.4f} m in stored copies, and over"
            f" {snapshot.views_range_m:.4f} m in stored views. Copy what you keep:",
            "log.push(data.site_xpos.slice());",
        )
    if examined.data.again_bytes:
        yield (
            "An MjData stays in the heap until it is deleted, even after a garbage collection:"
            f" {_taken(examined.data)}. Delete it:",
            "data.delete();",
        )
    if examined.contact.again_bytes:
        yield (
            "Each read of data.contact copies all contacts, and the copy stays in the heap, too:"
            f" {_taken(examined.contact)}, of {examined.contact.ncon} contacts each. Delete it:",
            "const contacts = data.contact; /* … */ contacts.delete();",
        )
    if not examined.state.is_array_written:
        error = examined.state.error
        how = f"fails: {error}" if error else "raises no error"
        yield (
            f"mj_getState writes nothing to a Float64Array, and {how}. Give it a buffer in the"
            " heap:",
            "const state = new mujoco.DoubleBuffer(size); mujoco.mj_getState(model, data, state,"
            " sig); log.push(state.GetView().slice());",
        )


def _growth(examined: Examined) -> tuple[str, str]:
    """Return what became of a stored view when the heap grew."""
    growth = examined.growth
    grew = f"{growth.heap_bytes / _MIB:.0f} to {growth.grown_bytes / _MIB:.0f} MiB"
    others = "another MjData" if growth.created == 1 else f"{growth.created} more MjData"
    if growth.is_live:
        return (
            f"A stored view stays valid when the heap grows, because its memory is shared: {others}"
            f" made it grow from {grew}, and a stored data.qpos still shows the current state",
            "",
        )
    return (
        f"A stored view becomes invalid when the heap grows: {others} made it grow from {grew}, and"
        f" a stored data.qpos then had {growth.grown_length} numbers instead of {growth.length}."
        " Take the view anew each time you need it:",
        "data.qpos[0]",
    )


def _limit(limits: Sequence[HeapLimit]) -> tuple[str, str]:
    """Return how many MjData fill the heap, and what makes them smaller."""
    usual, *others = limits
    text = (
        f"{usual.count:,} MjData of a box on a plane fill the heap, which ends at"
        f" {usual.heap_bytes / _GIB:.1f} GiB; the next one fails: {usual.error}"
    )
    if not usual.error:  # it has room for more than are tried
        text = f"{usual.count:,} MjData of a box on a plane fit into the heap"
    smaller = max(others, key=lambda limit: limit.count, default=usual)
    if smaller.count <= usual.count:
        return text, ""
    return f"{text}. {smaller.count:,} fit with this in the MJCF:", smaller.size


def _taken(memory: ObjectMemory) -> str:
    """Return the memory that unreferenced objects took."""
    total_bytes = memory.undeleted_bytes + memory.again_bytes
    return f"{2 * memory.count:,} of them took {total_bytes / _MIB:.0f} MiB"


def _mathematics(mathematics: Mathematics) -> str:
    """Return how often sines and cosines differ."""
    if not mathematics.sines + mathematics.cosines:
        return f"Sines and cosines of {mathematics.count:,} angles are C's, to the last bit"
    sines, cosines = (
        f"{100 * count / mathematics.count:.1f} %"
        for count in (mathematics.sines, mathematics.cosines)
    )
    return (
        f"Of {mathematics.count:,} angles, {sines} of the sines and {cosines} of the cosines differ"
        f" from those of this system's C library, by {mathematics.difference:.1e} at most"
    )
