"""What `mjbench web` prints: WebAssembly builds beside C."""

from collections.abc import Iterator

from rich.console import Console

from mjbench.comparison.plan import Variant
from mjbench.instrument.stats import Estimate
from mjbench.report import tables
from mjbench.report.starts import starts_lines
from mjbench.status import Status
from mjbench.web.records import C_PATH, WebPath, WebRecord
from mjbench.web.rounding_check import FirstDifference, RoundingCheck

_MIB = 1 << 20
# Below so many milliseconds, a block of C takes visibly longer than its steps.
_SHORT_MS = 1.0


def print_model(out: Console, record: WebRecord) -> None:
    """Print what was measured of a model, the conclusion first."""
    out.print()
    heading, _, text = conclusion(record).partition(": ")
    out.print(tables.headed(heading, f": {text}"), soft_wrap=True)
    if record.work is None:
        return
    out.print(
        f"MuJoCo {record.release}, Node {record.node};"
        f" {record.nbatch} × {record.nstep} steps compared,"
        f" {record.block_nbatch} × {record.block_nstep} in a block;"
        f" {record.work.contacts:.1f} contacts and"
        f" {record.work.constraints:.1f} constraints a step",
        soft_wrap=True,
    )
    for line in starts_lines(record.starts):
        out.print(line, soft_wrap=True)
    headings = (
        *("path", "ns/step", "× C", "", "agrees", "difference"),
        *("start ms", "model ms", "first ns/step", "heap MiB", "process MiB"),
    )
    table = tables.plain_table(headings, right=(1, 2, 5, 6, 7, 8, 9, 10))
    for path in record.path_results:
        table.add_row(*_cells(path))
    out.print(table)
    for line in notes(record):
        out.print(line, soft_wrap=True)


def conclusion(record: WebRecord) -> str:
    """Return what follows for a model, in one sentence."""
    if record.status != Status.OK:
        return f"{record.model}: {record.status}: {record.detail}"
    wasm = [path for path in record.path_results if path.is_wasm]
    if not wasm:
        return f"{record.model}: no build was compared"
    first = next((path for path in wasm if path.status == Status.OK), None)
    if first is None:
        bad = next((path for path in wasm if path.status == Status.DISAGREES), wasm[0])
        return f"{record.model}: {_name(bad)}: {bad.status}: {bad.detail}"
    parts = ["" if first.check is None else _agreement(first.check)]
    if first.ratio is not None:
        name = "WebAssembly" if first is wasm[0] else f"WebAssembly ({_name(first)})"
        times = f"{tables.factor(first.ratio.median)} times as long as in C{_interval(first.ratio)}"
        parts.insert(0, f"in {name}, a step takes {times}")
    if others := [_name(path) for path in wasm if path.status == Status.DISAGREES]:
        verb = "disagrees" if len(others) == 1 else "disagree"
        parts.append(f"{', '.join(others)} {verb} with C")
    return f"{record.model}: {'; '.join(filter(None, parts))}"


def _agreement(check: RoundingCheck) -> str:
    """Return how far a build that agrees is from C, as part of a sentence."""
    if check.first is None:
        return "its states are C's to the last bit"
    if not check.final.difference:
        return f"over {check.nstep} steps its positions, velocities and activations are C's"
    return f"after {check.nstep} steps its states are within {check.final.difference:.1e} of C's"


def notes(record: WebRecord) -> list[str]:
    """Return the lines below the table of a model."""
    lines = list(_short_blocks(record))
    checks: dict[str, list[str]] = {}
    for path in record.path_results:
        if path.check is not None:
            for line in _check_lines(path.check):
                checks.setdefault(line, []).append(_name(path))
    lines += [f"{', '.join(names)}: {line}" for line, names in checks.items()]
    lines += [
        f"{_name(path)}: {path.status}: {path.detail}"
        for path in record.path_results
        if path.status != Status.OK
    ]
    return lines


def _short_blocks(record: WebRecord) -> Iterator[str]:
    """Yield a warning if blocks are so short that more than the steps counts."""
    step_ns = next((path.step_ns for path in record.path_results if path.path == C_PATH), None)
    if step_ns is None or record.block_nbatch is None or record.block_nstep is None:
        return
    block_ms = 1e-6 * step_ns * record.block_nbatch * record.block_nstep
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


def _cells(path: WebPath) -> Iterator[str]:
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


def _name(path: WebPath) -> str:
    return str(Variant(path.path, path.options))


def _interval(ratio: Estimate) -> str:
    if ratio.low is None or ratio.high is None:
        return ""
    return f" ({tables.factor(ratio.low)} to {tables.factor(ratio.high)})"


def _small(value: float) -> str:
    return "0" if value == 0 else f"{value:.1e}"
