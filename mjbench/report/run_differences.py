"""How measurements of `compare` differ from earlier ones, row by row, each machine for itself."""

from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from mjbench.comparison.plan import Variant, describe_options
from mjbench.comparison.records import MeasurementRecord, ModelRecord
from mjbench.errors import InputError
from mjbench.host.machine import Machine
from mjbench.measuring import stats
from mjbench.measuring.ratio import Ratio
from mjbench.measuring.stats import TimedBlocks
from mjbench.paired.outcomes import Verdict
from mjbench.paired.race_record import RaceRecord
from mjbench.paths.accelerated import CPU
from mjbench.report import formats
from mjbench.report.content import Column, Conclusion, DataTable, Section, Tone
from mjbench.report.path_speedups import PathResult, derive_all, steps_per_block
from mjbench.simulation.accelerated_judgement import Precision
from mjbench.status import Status
from mjbench.store.machine_identity import MachineIdentity, identify
from mjbench.store.run_set import RunSet
from mjbench.store.runs import Run
from mjbench.units import count_of

# What must not differ where something was compiled: what compiled it, and with which flags.
_COMPILERS = ("jax", "jaxlib", "warp-lang")
_COMPILER_FLAGS = ("XLA_FLAGS", "JAX_DEFAULT_MATMUL_PRECISION", "NVIDIA_TF32_OVERRIDE")

# Less is what a machine does from one run to another, as far as anyone can tell from two runs.
MIN_EFFECT = 0.05

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
      machine: name of the machine that measured both; empty for two run files.
      cautions: what to know before the ratio: what disturbed either, and which is of an earlier
        version of mjbench; then the ratio has no interval.
    """

    model: str
    path: str
    options: Mapping[str, Any]
    nbatch: int | None
    status: Status = Status.OK
    detail: str = ""
    ratio: Ratio | None = None
    verdict: Verdict | None = None
    machine: str = ""
    cautions: Sequence[str] = ()


def differences(old: RunSet, new: RunSet, across: bool) -> list[RunDifference]:
    """Return how runs of `compare` differ: of two run files, or of each machine in two sets.

    In sets, a machine is the same by its label or host where both know it, else by its kind where
    only one is of that kind (see `machine_identity`). A machine that only one of them has is a row
    that says so. `across`: compare also what differs in identity (see `identity`).
    """
    old_runs, new_runs = (
        [run for run in stored.runs if run.of_type(MeasurementRecord)] for stored in (old, new)
    )
    if old.is_run_file and new.is_run_file:
        return run_differences(old_runs, new_runs, across)
    machines = identify([run.header.machine for run in (*old_runs, *new_runs)])
    of_old, of_new = machines[: len(old_runs)], machines[len(old_runs) :]
    rows: list[RunDifference] = []
    for machine in dict.fromkeys(machines):
        if machine not in of_new:
            rows.append(_missing(machine, "NEW", of_new))
        elif machine not in of_old:
            rows.append(_missing(machine, "OLD", of_old))
        else:
            olds = [run for run, m in zip(old_runs, of_old, strict=True) if m == machine]
            news = [run for run, m in zip(new_runs, of_new, strict=True) if m == machine]
            same = run_differences(olds, news, across)
            rows += [replace(row, machine=machine.name) for row in same]
    return rows


def _missing(
    machine: MachineIdentity, absent: str, others: Sequence[MachineIdentity]
) -> RunDifference:
    same_kind = {other for other in others if other.kind == machine.kind}
    knows_host = bool(machine.label or machine.host)
    if same_kind and not (knows_host and all(other.label or other.host for other in same_kind)):
        detail = f"it may be one of {len(same_kind)} of this kind in {absent}: its host is unknown"
    else:
        detail = f"not in {absent}"
    return RunDifference("", "", {}, None, Status.UNAVAILABLE, detail, machine=machine.name)


def run_differences(old: Sequence[Run], new: Sequence[Run], across: bool) -> list[RunDifference]:
    olds, news = _timed(old), _timed(new)
    return [_difference(olds[key], news[key], across) for key in news if key in olds]


def identity(record: MeasurementRecord, machine: Machine) -> dict[str, object]:
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
    """A measurement, the machine that did it, and seconds of a step in each launch or block."""

    record: MeasurementRecord
    machine: Machine
    step_s: Sequence[float]
    result: PathResult | None

    @property
    def is_former(self) -> bool:
        return self.result is not None and self.result.is_former

    def cautions(self, name: str) -> list[str]:
        """Return what to know before its figures; `name` says which of the two it is."""
        former = ["timed by an earlier version of mjbench"] if self.is_former else []
        disturbances = self.result.disturbances if self.result else ()
        return [f"{name}: {text}" for text in (*disturbances, *former)]


def _difference(olds: Sequence[_Timed], news: Sequence[_Timed], across: bool) -> RunDifference:
    old, new = olds[-1].record, news[-1].record
    status, detail, ratio = Status.OK, "", None
    cautions = [*olds[-1].cautions("OLD"), *news[-1].cautions("NEW")]
    try:
        for name, timed in (("OLD", olds), ("NEW", news)):
            if len(timed) > 1:
                raise InputError(f"{name} has it {len(timed)} times: give the run file you mean")
        if new.workload_digest != old.workload_digest:
            raise InputError("not comparable: their workloads differ")
        if new.returns != old.returns:
            raise InputError(f"not comparable: one returns {old.returns}, the other {new.returns}")
        # how many times faster the old one is: new time over old
        speedup = stats.unpaired(
            TimedBlocks(news[-1].step_s, identity(new, news[-1].machine)),
            TimedBlocks(olds[-1].step_s, identity(old, olds[-1].machine)),
            across,
        )
        is_former = olds[-1].is_former or news[-1].is_former
        ends = (None, None) if is_former else (speedup.low, speedup.high)
        ratio = Ratio(speedup.median, *ends)
    except InputError as error:
        status, detail = Status.INPUT, str(error)
    return RunDifference(
        new.model,
        new.path,
        new.options,
        new.nbatch,
        status,
        detail,
        ratio,
        Verdict.INCONCLUSIVE if ratio is not None and cautions else _verdict(ratio),
        cautions=cautions,
    )


def _verdict(ratio: Ratio | None) -> Verdict | None:
    if ratio is None or ratio.low is None or ratio.high is None:
        return None
    if ratio.low > 1 + MIN_EFFECT:
        return Verdict.SLOWER
    if ratio.high < 1 / (1 + MIN_EFFECT):
        return Verdict.FASTER
    is_same = ratio.low > 1 / (1 + MIN_EFFECT) and ratio.high < 1 + MIN_EFFECT
    return Verdict.SAME if is_same else Verdict.INCONCLUSIVE


def _timed(runs: Sequence[Run]) -> dict[_Key, list[_Timed]]:
    """Return what runs timed by what must be the same to be compared; of a run, the last."""
    timed: dict[_Key, list[_Timed]] = defaultdict(list)
    for run in runs:
        models = derive_all(run.records)
        results = {_key(r): (r, each.race) for each in models for r in each.results}
        of_run: dict[_Key, _Timed] = {}
        for record in run.of_type(MeasurementRecord):
            result, race = results.get(_key(record), (None, None))
            step_s = _step_s(record, race)
            if record.agrees and record.status == Status.OK and step_s:
                of_run[_key(record)] = _Timed(record, run.header.machine, step_s, result)
        for key, measured in of_run.items():
            timed[key].append(measured)
    return timed


def _key(record: MeasurementRecord) -> _Key:
    return record.model, record.path, repr(sorted(record.options.items())), record.nbatch


def _step_s(record: MeasurementRecord, race: RaceRecord | None) -> Sequence[float]:
    """Return the seconds of a step in each launch, or in each block of one process."""
    if record.samples_s:
        steps = steps_per_block(record)
        return [seconds / steps for seconds in record.samples_s]
    return race.step_s(Variant(record.path, record.options)) if race is not None else ()


def differences_section(rows: Sequence[RunDifference]) -> Section:
    """Return what `mjbench show --against` comes to."""
    cautions = [
        f"{', '.join(filter(None, (row.machine, row.model)))}: {caution}"
        for row in rows
        for caution in row.cautions
    ]
    warned = [Conclusion(caution, Tone.CAUTION) for caution in dict.fromkeys(cautions)]
    return Section(
        "NEW against OLD",
        [*warned, _conclusion(rows)],
        tables=[_table(rows)],
        notes=[
            "The two were measured at different times; to find smaller differences, alternate both:"
            " `mjbench versions` or `mjbench ab`",
            *["Rows without a verdict have too few launches: their paths left a race early"]
            * any(row.ratio is not None and row.verdict is None for row in rows),
        ],
    )


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
        name = ", ".join(filter(None, (row.machine, row.model, path)))
        parts += f"; the slowest is {name}, by {formats.short_percent(ratio - 1)}"
    return Conclusion(f"Of {count_of(len(rows), 'row')}: {parts}", tone)


def _table(rows: Sequence[RunDifference]) -> DataTable:
    digits = formats.decimals(3)
    return DataTable.of(
        "Differences",
        rows,
        (Column("machine"), lambda row: row.machine),
        (Column("model"), lambda row: row.model),
        (Column("path"), lambda row: row.path),
        (Column("options"), lambda row: describe_options(row.options)),
        (Column("simulations", formats.count, leaves=1), lambda row: row.nbatch),
        (Column("new / old", digits), lambda row: row.ratio.estimate if row.ratio else None),
        (Column("95 %", formats.ends_in(digits)), lambda row: row.ratio),
        (Column("verdict"), lambda row: row.verdict.value if row.verdict else None),
        (Column("detail"), lambda row: row.detail),
    )


def left_out(stored: Sequence[RunSet]) -> str:
    """Return which runs of sets are not compared, in a line; empty where all are."""
    commands = Counter(
        each.header.command
        for one in stored
        if not one.is_run_file
        for each in one.runs
        if not each.of_type(ModelRecord)
    )
    if not commands:
        return ""
    counts = ", ".join(f"{count} of {command}" for command, count in commands.items())
    return f"left out: runs of other commands than compare ({counts})"
