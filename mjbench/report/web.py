"""What `mjbench web` comes to: WebAssembly builds beside C."""

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence

from mjbench.comparison.plan import Variant
from mjbench.report import formats
from mjbench.report.content import Column, Conclusion, DataTable, Section, Tone
from mjbench.report.starts import starts_lines
from mjbench.status import Status
from mjbench.web.records import C_PATH, WebPath, WebRecord
from mjbench.web.rounding_check import FirstDifference, RoundingCheck

# What the flat table has of a path.
_ROW_KEYS = (
    *("path", "options", "status", "detail", "is_identical", "difference"),
    *("step_ns", "steps_per_s", "ratio", "heap_bytes", "rss_bytes"),
)
# Below so many milliseconds, a block of C takes visibly longer than its steps.
_SHORT_MS = 1.0


def sections(records: Sequence[WebRecord]) -> Iterator[Section]:
    for record in records:
        is_good = all(status in (Status.OK, Status.UNAVAILABLE) for status in record.statuses())
        yield Section(
            heading=f"{record.model} in WebAssembly",
            conclusions=[
                *(Conclusion(text, Tone.CAUTION) for text in _short_blocks(record)),
                Conclusion(conclusion(record), Tone.NEUTRAL if is_good else Tone.BAD),
            ],
            facts=_facts(record),
            tables=[_table(record)],
            notes=[*notes(record)],
        )


def rows(record: WebRecord) -> Iterator[Mapping[str, object]]:
    for path in record.path_results:
        figures = {key: getattr(path, key) for key in _ROW_KEYS}
        yield {"model": record.model, "release": record.release, **figures}


def _facts(record: WebRecord) -> list[str]:
    if record.work is None:
        return []
    return [
        f"MuJoCo {record.release}, Node {record.node}; {record.nbatch} × {record.nstep} steps"
        f" compared, {record.block_nbatch} × {record.block_nstep} in a block;"
        f" {record.work.contacts:.1f} contacts and {record.work.constraints:.1f} constraints a"
        " step",
        *starts_lines(record.starts),
    ]


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
        interval = formats.in_brackets(first.ratio)
        times = f"{formats.factor(first.ratio.median)} times as long as in C{interval}"
        parts.insert(0, f"in {name}, a step takes {times}")
    if others := [_name(path) for path in wasm if path.status == Status.DISAGREES]:
        verb = "disagrees" if len(others) == 1 else "disagree"
        parts.append(f"{', '.join(others)} {verb} with C")
    return f"{record.model}: {'; '.join(filter(None, parts))}"


def _agreement(check: RoundingCheck) -> str:
    if check.first is None:
        return "its states are C's to the last bit"
    if not check.final.difference:
        return f"over {check.nstep} steps its positions, velocities and activations are C's"
    return f"after {check.nstep} steps its states are within {check.final.difference:.1e} of C's"


def notes(record: WebRecord) -> Iterator[str]:
    checks = defaultdict[str, list[str]](list)
    for path in record.path_results:
        for line in _check_lines(path.check) if path.check else ():
            checks[line].append(_name(path))
    yield from (f"{', '.join(names)}: {line}" for line, names in checks.items())
    for path in record.path_results:
        if path.status != Status.OK:
            yield f"{_name(path)}: {path.status}: {path.detail}"


def _short_blocks(record: WebRecord) -> Iterator[str]:
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
    if check.first is None:
        yield f"identical to C, to the last bit, over {check.nstep} steps"
    else:
        yield f"first differs from C {check.first}{_of_same_model(check)}"
        later = check.points[1:]
        steps = ", ".join(str(point.step) for point in later)
        differences, shadows = (
            ", ".join(_small(value) for value in values)
            for values in ([point.difference for point in later], [point.shadow for point in later])
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


def _table(record: WebRecord) -> DataTable:
    return DataTable.of(
        f"Steps of {record.model}, and times over those of C",
        record.path_results,
        (Column("path"), _name),
        (Column("ns/step", formats.count), lambda path: path.step_ns),
        (Column("× C", formats.factor), lambda path: path.ratio.median if path.ratio else None),
        (Column("95 %", formats.ends), lambda path: path.ratio if path.is_wasm else None),
        (Column("agrees"), _agrees),
        (
            Column("difference", _small, leaves=6),
            lambda path: path.check.final.difference if path.check else None,
        ),
        (
            Column("start ms", formats.count, leaves=5),
            lambda path: s.import_ms + s.instantiate_ms if (s := path.start_up) else None,
        ),
        (
            Column("model ms", formats.count, leaves=4),
            lambda path: s.compile_ms if (s := path.start_up) else None,
        ),
        (
            Column("first ns/step", formats.count, leaves=3),
            lambda path: s.first_ns if (s := path.start_up) else None,
        ),
        (Column("heap MiB", _mebibytes, leaves=2), lambda path: path.heap_bytes),
        (Column("process MiB", _mebibytes, leaves=1), lambda path: path.rss_bytes),
    )


def _agrees(path: WebPath) -> str | None:
    if path.check is None:
        return None if path.status == Status.OK else path.status.value
    identical = "identical" if path.check.first is None else "yes"
    return "NO" if path.status == Status.DISAGREES else identical


def _mebibytes(size: int) -> str:
    return formats.count(size / 2**20)


def _name(path: WebPath) -> str:
    return str(Variant(path.path, path.options))


def _small(value: float) -> str:
    return "0" if value == 0 else f"{value:.1e}"
