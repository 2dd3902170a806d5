"""The page that tells what a history shows (docs/history.md), written from asv's results alone.

What no measurement can tell, the cause of a step, comes from a table kept by hand
(benchmarks/causes.toml), which names items of MuJoCo's changelog.
"""

import re
import tomllib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from mjbench.errors import InputError, one_line
from mjbench.releases import history as room
from mjbench.releases.history import ChangePoint, History, Series

CAUSE = "cause, by MuJoCo's changelog where it names one"


@dataclass(frozen=True)
class Cause:
    """An item of MuJoCo's changelog that explains steps.

    Attributes:
      release: in which it came.
      where: regular expression over `benchmark (parameters)` of the steps it explains.
      commit: by which the changelog names the item; empty where it names none.
      text: what the item changed, in our words.
    """

    release: str
    where: str
    commit: str
    text: str


def causes(file: Path) -> list[Cause]:
    """Read the table of causes.

    Raises:
      InputError: it cannot be read, or an entry lacks something.
    """
    try:
        entries = tomllib.loads(file.read_text(encoding="utf-8")).get("cause", [])
        return [Cause(**entry) for entry in entries]
    except (OSError, ValueError, TypeError) as error:
        raise InputError(f"cannot read {file}: {one_line(error)}") from error


def page(history: History, known: Sequence[Cause], threshold: float = room.THRESHOLD) -> str:
    """Return the page, in Markdown."""
    engine = room.paired_change_points(history, threshold)
    others = [
        s for s in room.change_points(history, threshold) if s.series.benchmark not in room.TIMES
    ]
    parts = [
        _head(history, threshold),
        "## A step of each model\n",
        "Microseconds of one `mj_step` from Python, median of all samples, unpaired: single values"
        " are off by up to a quarter where the machine was slow. ▲ and ▼ mark the paired steps told"
        " below.\n",
        *_by_release(history, engine),
        "\n## Instructions of a step\n",
        "Thousands of instructions of one `mj_step` over the stored work, counted by Callgrind:"
        " two counts differ by at most 0.1 %. ▲ and ▼ mark changes above"
        f" {room.COUNT_THRESHOLD:.0%} from the release before. Counts tell what the code does, not"
        " how long it takes.\n",
        *_counts(history),
        "\n## Steps of `mj_step`\n",
        *_engine_table(history, engine, known, threshold),
        "\n## Steps around it\n",
        *_other_table(others, known, threshold),
        "\n## Releases that compute something else\n",
        "One step from the stored states, and what a hundred steps had to do, against the release"
        " before.\n",
        *_physics(history),
        "\n## What has no number\n",
        *_gaps(history),
    ]
    return "\n".join(parts).rstrip() + "\n"


def _head(history: History, threshold: float) -> str:
    machine = history.machine
    counted = [s for s in history.series if s.timed]
    rounds = {len(p.rounds) for s in counted for p in s.points.values() if p.measured}
    about = [machine[k] for k in ("cpu", "arch", "os") if machine.get(k)]
    cores = f", {machine['num_cpu']} cores" if machine.get("num_cpu") else ""
    return (
        "# What the history shows\n\n"
        "Written by `mjbench history` from the results in `results/asv`; do not edit.\n\n"
        f"{len(history.versions)} releases of MuJoCo, {history.versions[0]} to"
        f" {history.versions[-1]}, measured by asv on `{machine['machine']}`"
        f" ({', '.join(about)}{cores}). Times: `asv run --interleave-rounds --record-samples`,"
        f" {max(rounds, default=0)} rounds in opposite orders. Steps of `mj_step` are those of the"
        " *paired* ratio to one fixed release, which the machine's drift cannot bend"
        " (`benchmarks/reference.py`), where some unpaired round shows half of it too. Steps around"
        f" it are of unpaired times: they must show in every round, and separate the {room.LEVEL}"
        f" releases before from those after. Told is what exceeds {threshold:.0%} from one release"
        " to the next. Absolute times are this machine's. [method.md](method.md) says how a number"
        " comes about.\n"
    )


def _by_release(history: History, steps: Sequence[ChangePoint]) -> Iterator[str]:
    columns = [s for s in history.series if s.benchmark in room.TIMES]
    columns.sort(key=lambda s: (s.benchmark == room.TIMES[1], s.label))
    yield "| release | " + " | ".join(f"`{s.label}`" for s in columns) + " |"
    yield "|---|" + "---:|" * len(columns)
    marks = {(s.series.params["model"], s.new): "▲" if s.ratio > 1 else "▼" for s in steps}
    for version in history.versions:
        cells = [_micro(s, version) + marks.get((s.label, version), "") for s in columns]
        yield f"| {version} | " + " | ".join(cells) + " |"


def _counts(history: History) -> Iterator[str]:
    columns = sorted(
        (s for s in history.series if s.benchmark == room.COUNT), key=lambda s: s.label
    )
    if not columns:
        yield "Not counted."
        return
    yield "| release | " + " | ".join(f"`{s.label}`" for s in columns) + " |"
    yield "|---|" + "---:|" * len(columns)
    before: dict[str, float] = {}
    for version in history.versions:
        cells = []
        for series in columns:
            point = series.points.get(version)
            if point is None or not point.measured:
                cells.append("–")
                continue
            value = float(point.value or 0.0)
            ratio = value / before.get(series.label, value)
            mark = "▲" if ratio > 1 + room.COUNT_THRESHOLD else ""
            mark = "▼" if ratio < 1 - room.COUNT_THRESHOLD else mark
            cells.append(f"{value / 1000:.4g}{mark}")
            before[series.label] = value
        yield f"| {version} | " + " | ".join(cells) + " |"


def _micro(series: Series, version: str) -> str:
    point = series.points.get(version)
    if point is None or not point.measured:
        return "" if point is None else "failed" if point.value is None else "–"
    # a call does 1000 steps, or 100
    return f"{1e6 * float(point.value or 0) / series.times:.3g}"


def _engine_table(
    history: History, steps: Sequence[ChangePoint], known: Sequence[Cause], threshold: float
) -> Iterator[str]:
    if not steps:
        yield f"None above {threshold:.0%}."
        return
    heads = ("release", "model", "time of a step, paired", "unpaired, by round", "instructions")
    yield f"| {' | '.join(heads)} | work | {CAUSE} |"
    yield "|---|---|---:|---:|---:|---|---|"
    for step in steps:
        model = step.series.params["model"]
        work = room.work_changes(history, model, step.old, step.new)
        counted = room.count_ratio(history, model, step.old, step.new)
        yield (
            f"| {step.new} | `{model}` | {_change(step.ratio)} |"
            f" {', '.join(_change(r) for r in step.rounds)} |"
            f" {'' if counted is None else _change(counted)} |"
            f" {'; '.join(work) or 'the same'} | {_cause(step, known)} |"
        )


def _other_table(
    steps: Sequence[ChangePoint], known: Sequence[Cause], threshold: float
) -> Iterator[str]:
    """One row for a release and benchmark: its parameters usually step together."""
    if not steps:
        yield f"None above {threshold:.0%}."
        return
    yield f"| release | benchmark | with | change | {CAUSE} |"
    yield "|---|---|---|---:|---|"
    groups: dict[tuple[str, str, bool], list[ChangePoint]] = {}
    for step in steps:
        groups.setdefault((step.new, step.series.title, step.ratio > 1), []).append(step)
    for (release, title, _), group in groups.items():
        ratios = sorted(s.ratio for s in group)
        change = _change(ratios[0])
        if len(ratios) > 1:
            change += f" to {_change(ratios[-1])}"
        labels = [s.series.label for s in group if s.series.label]
        with_ = f"{len(labels)} choices" if len(labels) > 4 else "; ".join(labels)
        told = sorted({_cause(s, known) for s in group})
        yield f"| {release} | {title} | {with_} | {change} | {'; '.join(told)} |"


def _change(ratio: float) -> str:
    return f"×{ratio:.2f}" if ratio >= 2 or ratio <= 0.5 else f"{100 * (ratio - 1):+.1f} %"


def _cause(step: ChangePoint, known: Sequence[Cause]) -> str:
    where = f"{step.series.benchmark} ({step.series.label})"
    found = [c for c in known if c.release == step.new and re.search(c.where, where)]
    if not found:
        return "none named"
    return "; ".join(c.text + (f" (`{c.commit}`)" if c.commit else "") for c in found)


def _physics(history: History) -> Iterator[str]:
    models = sorted({s.params["model"] for s in history.series if s.benchmark == room.DRIFT})
    yield "| release | model: what changed |"
    yield "|---|---|"
    nothing = True
    for old, new in zip(history.versions, history.versions[1:], strict=False):
        changed = {m: room.work_changes(history, m, old, new) for m in models}
        told = [f"`{m}`: {', '.join(words)}" for m, words in changed.items() if words]
        if told:
            nothing = False
            yield f"| {new} | {'<br>'.join(told)} |"
    if nothing:
        yield "| none | |"


def _gaps(history: History) -> Iterator[str]:
    found = room.gaps(history)
    if not found:
        yield "Everything was measured in every release."
        return
    merged: dict[tuple[str, str, tuple[str, ...]], list[str]] = {}
    for title, label, versions, kind in found:
        merged.setdefault((title, kind, tuple(versions)), []).append(label)
    yield "| benchmark | with | | releases |"
    yield "|---|---|---|---|"
    for (title, kind, missing), labels in merged.items():
        with_ = f"{len(labels)} choices" if len(labels) > 4 else "; ".join(filter(None, labels))
        yield f"| {title} | {with_} | {kind} | {_range(history, missing)} |"


def _range(history: History, versions: Sequence[str]) -> str:
    """Return versions with runs of neighbours as `first to last`."""
    order = list(history.versions)
    runs: list[list[str]] = []
    for version in versions:
        if runs and order.index(version) == order.index(runs[-1][-1]) + 1:
            runs[-1].append(version)
        else:
            runs.append([version])
    return ", ".join(r[0] if len(r) == 1 else f"{r[0]} to {r[-1]}" for r in runs)
