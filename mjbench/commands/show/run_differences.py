"""How measurements of `compare` differ from earlier ones, row by row."""

import math
import statistics
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from mjbench import formats
from mjbench.commands.compare.results import PathResult, derive_all
from mjbench.formats import count_of
from mjbench.host.machine import Machine
from mjbench.interval import Interval
from mjbench.measuring import stats
from mjbench.paired.outcomes import Verdict
from mjbench.paths.accelerated import CPU
from mjbench.results import machine_identity
from mjbench.results.content import Column, Conclusion, DataTable, Section, Tone
from mjbench.results.runs import Run
from mjbench.simulation.accelerated_judgement import Precision
from mjbench.status import Status
from mjbench.verification.plan import Variant, describe_options
from mjbench.verification.records import VariantRecord

# What must not differ where something was compiled: what compiled it, and with which flags.
_COMPILERS = ("jax", "jaxlib", "warp-lang")
_COMPILER_FLAGS = ("XLA_FLAGS", "JAX_DEFAULT_MATMUL_PRECISION", "NVIDIA_TF32_OVERRIDE")

# Less is what a machine does from one run to another, as far as anyone can tell from two runs.
MIN_EFFECT = 0.05

# From so many rows on, one factor for all is no chance.
_LEAST_COMMON = 3

# Model, path, options and simulations.
_Key = tuple[str, str, str, int | None]


@dataclass(frozen=True)
class RunDifference:
    """One variant that was timed in both runs.

    Attributes:
      status: `ok`, `input` where the two cannot be compared, or `unavailable` where one is missing.
      detail: why they cannot; empty when ok.
      ratio: new time of a step over old time.
      verdict: what the interval of the ratio says beside `MIN_EFFECT`; `inconclusive` with
        cautions, None without an interval: paths that left a race early have too few launches.
      cautions: what to know before the ratio: what disturbed either.
      is_of_one_engine: whether both ran the same version of MuJoCo.
    """

    model: str
    path: str
    options: Mapping[str, Any]
    nbatch: int | None
    status: Status = Status.OK
    detail: str = ""
    ratio: Interval | None = None
    verdict: Verdict | None = None
    cautions: Sequence[str] = ()
    is_of_one_engine: bool = False


def differences(old: Run, new: Run, across: bool) -> list[RunDifference]:
    """Return how two runs of `compare` differ.

    `across`: compare also what differs in identity (see `identity`).
    """
    olds, news = _timed(old), _timed(new)
    rows = [_difference(olds[key], news[key], across) for key in news if key in olds]
    changed_speed = machine_identity.changed_speed(old.header.machine, new.header.machine)
    if not changed_speed:
        return rows
    return [
        replace(
            row,
            verdict=row.verdict and Verdict.INCONCLUSIVE,
            cautions=[*row.cautions, changed_speed],
        )
        for row in rows
    ]


def _of_common_factor(rows: Sequence[RunDifference]) -> Iterator[Conclusion]:
    """Yield that all rows of one MuJoCo moved by one factor, as they do on a slower machine."""
    logs = [math.log(row.ratio.estimate) for row in rows if row.ratio is not None]
    if len(logs) < _LEAST_COMMON or not all(row.is_of_one_engine for row in rows):
        return
    common, within = statistics.median(logs), math.log1p(MIN_EFFECT)
    if abs(common) > within and all(abs(each - common) < within for each in logs):
        yield Conclusion(
            f"All {len(logs)} rows take {formats.factor(math.exp(common))} times as long, and"
            " MuJoCo is the same: that is probably the machine",
            Tone.UNSURE,
        )


def identity(record: VariantRecord, machine: Machine) -> dict[str, object]:
    """Return what two measurements must share to be compared without being asked to.

    Precision and device (a CPU by its name); of what was compiled also the versions of its
    compilers, and the flags that change what they do.
    """
    device = record.device or CPU
    values: dict[str, object] = {
        "precision": record.precision or Precision.FLOAT64,
        "device": machine.cpu if device == CPU else device,
    }
    if record.is_accelerated:
        values |= {name: machine.versions.get(name) for name in _COMPILERS}
        values |= {name: machine.flags.get(name) for name in _COMPILER_FLAGS}
    return values


@dataclass(frozen=True)
class _Timed:
    """A result, the machine that measured it, and seconds of a step in each launch or block."""

    result: PathResult
    machine: Machine
    step_s: Sequence[float]


def _difference(before: _Timed, after: _Timed, across: bool) -> RunDifference:
    new, problem = after.result, _why_not_comparable(before, after, across)
    cautions = [f"OLD: {text}" for text in before.result.disturbances]
    cautions += [f"NEW: {text}" for text in new.disturbances]
    ratio = None if problem else _ratio(before, after)
    return RunDifference(
        new.model,
        new.path,
        new.options,
        new.nbatch,
        Status.INPUT if problem else Status.OK,
        problem,
        ratio,
        Verdict.INCONCLUSIVE if ratio is not None and cautions else _verdict(ratio),
        cautions=cautions,
        is_of_one_engine=before.machine.versions.get("mujoco")
        == after.machine.versions.get("mujoco"),
    )


def _why_not_comparable(before: _Timed, after: _Timed, across: bool) -> str:
    old, new = before.result.model_record, after.result.model_record
    if new.workload_digest != old.workload_digest:
        return "not comparable: their workloads differ"
    if old.returns != new.returns:
        return f"not comparable: one returns {old.returns}, the other {new.returns}"
    own, other = (identity(each.result, each.machine) for each in (after, before))
    differing = [
        f"{name} ({own.get(name)}, {other.get(name)})"
        for name in sorted({*own, *other})
        if own.get(name) != other.get(name)
    ]
    if across or not differing:
        return ""
    return f"not comparable, they differ in {', '.join(differing)}"


def _ratio(before: _Timed, after: _Timed) -> Interval:
    """Return new time of a step over old time.

    Each median has the confidence that leaves 95 % for both together (Bonferroni). Changes of the
    machine in between are not accounted for.
    """
    confidence = 1 - (1 - stats.CONFIDENCE) / 2
    new, old = (
        stats.median_of(stats.logarithms(each.step_s), confidence).exponential
        for each in (after, before)
    )
    return new.over(old)


def _verdict(ratio: Interval | None) -> Verdict | None:
    if ratio is None or ratio.half_width == math.inf:
        return None
    if ratio.is_above(1 + MIN_EFFECT):
        return Verdict.SLOWER
    if ratio.is_below(1 / (1 + MIN_EFFECT)):
        return Verdict.FASTER
    is_same = ratio.is_above(1 / (1 + MIN_EFFECT)) and ratio.is_below(1 + MIN_EFFECT)
    return Verdict.SAME if is_same else Verdict.INCONCLUSIVE


def _timed(run: Run) -> dict[_Key, _Timed]:
    """Return what a run timed, by what must be the same to be compared; the last of each."""
    timed: dict[_Key, _Timed] = {}
    for model_results in derive_all(run.records):
        model, race = model_results.model, model_results.race
        for result in filter(lambda each: each.is_timed, model_results.results):
            options = repr(sorted(result.options.items()))
            step_s = race.step_s(result.variant) if race is not None else []
            if result.samples_s and model.block_steps:
                step_s = [seconds / model.block_steps for seconds in result.samples_s]
            key = (model.model, result.path, options, model.nbatch)
            timed[key] = _Timed(result, run.header.machine, step_s)
    return timed


def differences_section(rows: Sequence[RunDifference]) -> Section:
    """Return what the differences come to."""
    return Section(
        "NEW beside OLD",
        [*_cautions(rows), _conclusion(rows), *_of_common_factor(rows)],
        tables=[_table(rows)],
        notes=[
            "The two were measured at different times; to find smaller differences, alternate both:"
            " `mjbench versions` or `mjbench ab`",
            *["Rows without a verdict have too few launches: their paths left a race early"]
            * any(row.ratio is not None and row.verdict is None for row in rows),
        ],
    )


def _cautions(rows: Sequence[RunDifference]) -> Iterator[Conclusion]:
    """Yield what to know before the ratios, once where it holds for all rows."""
    of_all = [each for each in rows[0].cautions if all(each in row.cautions for row in rows)]
    of_some = [
        f"{row.model}: {each}" for row in rows for each in row.cautions if each not in of_all
    ]
    for caution in dict.fromkeys([*of_all, *of_some]):
        yield Conclusion(caution, Tone.CAUTION)


def _conclusion(rows: Sequence[RunDifference]) -> Conclusion:
    counts = Counter(row.verdict for row in rows if row.status == Status.OK)
    tone = Tone.BAD if counts[Verdict.SLOWER] else Tone.UNSURE
    if {*counts} - {None} and {*counts} <= {Verdict.SAME, Verdict.FASTER, None}:
        tone = Tone.GOOD
    named = {
        Verdict.SLOWER: "slower",
        Verdict.FASTER: "faster",
        Verdict.SAME: f"the same within {100 * MIN_EFFECT:g} %",
        Verdict.INCONCLUSIVE: "undecided",
        None: "without a verdict",
    }
    numbers = [(counts[each], name) for each, name in named.items()]
    numbers.append((len(rows) - counts.total(), "not comparable"))
    parts = ", ".join(f"{number} {name}" for number, name in numbers if number)
    slower = [
        (row.ratio.estimate, row) for row in rows if row.ratio and row.verdict == Verdict.SLOWER
    ]
    if slower:
        ratio, row = max(slower, key=lambda each: each[0])
        path = str(Variant(row.path, row.options))
        parts += f"; the slowest is {row.model}, {path}, by {formats.short_percent(ratio - 1)}"
    if reason := _common_reason(rows):
        parts += f"; {reason}"
    return Conclusion(f"Of {count_of(len(rows), 'row')}: {parts}", tone)


def _common_reason(rows: Sequence[RunDifference]) -> str:
    """Return why no row can be compared, if it is the same for all; else empty."""
    reasons = {row.detail for row in rows}
    return reasons.pop() if len(reasons) == 1 else ""


def _table(rows: Sequence[RunDifference]) -> DataTable:
    digits, is_said = formats.decimals(3), bool(_common_reason(rows))
    return DataTable.of(
        "Differences",
        rows,
        (Column("model"), lambda row: row.model),
        (Column("path"), lambda row: row.path),
        (Column("options"), lambda row: describe_options(row.options)),
        (Column("simulations", formats.count, leaves=1), lambda row: row.nbatch),
        (Column("new / old", digits), lambda row: row.ratio.estimate if row.ratio else None),
        (Column("95 %", formats.ends_in(digits)), lambda row: row.ratio),
        (Column("verdict"), lambda row: row.verdict.value if row.verdict else None),
        (Column("detail"), lambda row: "" if is_said else row.detail),
    )
