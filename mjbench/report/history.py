"""The page docs/history.md: what changed between releases, written from asv's results alone.

Only the causes are added by hand (see mjbench.releases.causes).
"""

from collections.abc import Iterator, Sequence
from itertools import pairwise

from mjbench.releases.benchmark_names import STEP_TIMES, BenchmarkName
from mjbench.releases.causes import Cause, explaining
from mjbench.releases.history import (
    COUNT_THRESHOLD,
    NEIGHBOURS,
    THRESHOLD,
    ChangePoint,
    Gap,
    History,
    Series,
    count_ratio,
    gaps,
    paired_change_points,
    unpaired_change_points,
    work_changes,
)
from mjbench.report import tables
from mjbench.report.markdown import change, table

# Longer lists of parameters are only counted.
_MOST_LABELS = 4


def page(history: History, causes: Sequence[Cause], threshold: float = THRESHOLD) -> str:
    """Return the page, in Markdown.

    Args:
      history: asv's results.
      causes: of change points.
      threshold: the smallest change of a time that is listed, as a share.
    """
    of_step = paired_change_points(history, threshold)
    around_step = [
        change_point
        for change_point in unpaired_change_points(history, threshold)
        if change_point.series.benchmark not in STEP_TIMES
    ]
    lines = [
        *_introduction(history, threshold),
        "\n## Time of a step\n",
        "Microseconds of one `mj_step` from Python, median of all samples, unpaired: where the"
        " machine was slow, single values are off by up to a quarter. ▲ and ▼ mark the change"
        " points of `mj_step` listed below.\n",
        *_time_table(history, of_step),
        "\n## Instructions of a step\n",
        "Thousands of instructions of one `mj_step` over the stored workload, counted by"
        " Callgrind; two counts of the same work differ by at most 0.1 %. ▲ and ▼ mark changes"
        f" above {_percent(COUNT_THRESHOLD)} from the release before. A count says what"
        " the code does, not how long it takes.\n",
        *_instructions_table(history),
        "\n## Change points of `mj_step`\n",
        *_step_table(history, of_step, causes, threshold),
        "\n## Change points around `mj_step`\n",
        *_other_table(around_step, causes, threshold),
        "\n## Releases that compute something else\n",
        "Compared with the release before: what a hundred steps from the stored states had to do,"
        " and the result of one step.\n",
        *_work_table(history),
        "\n## Missing values\n",
        *_gap_table(history),
    ]
    return "\n".join(lines).rstrip() + "\n"


def _introduction(history: History, threshold: float) -> Iterator[str]:
    machine = history.machine
    timed = [series for series in history.series if series.is_timed]
    rounds = {len(p.rounds) for series in timed for p in series.points.values() if p.is_measured}
    description = [text for text in (machine.cpu, machine.arch, machine.os) if text]
    if machine.num_cpu:
        description.append(f"{machine.num_cpu} cores")
    decrease = 100 * (1 / (1 + threshold) - 1)  # the same factor downward
    yield "# What changed between releases\n"
    yield "Written by `mjbench history` from the results in `results/asv`; do not edit.\n"
    yield (
        f"{len(history.versions)} releases of MuJoCo, {history.versions[0]} to"
        f" {history.versions[-1]}, measured by asv on `{machine.machine}`"
        f" ({', '.join(description)}) with `asv run --interleave-rounds --record-samples`:"
        f" {max(rounds, default=0)} rounds, which visit the releases in opposite orders. Absolute"
        " times hold for this machine only. [method/history.md](method/history.md) describes how"
        " the releases are measured.\n"
    )
    yield (
        f"Listed: changes above {_percent(threshold)} from one release to the next, and decreases"
        f" below {decrease:.1f} %, which is the same factor.\n"
    )
    yield (
        "- Change points of `mj_step` are changes of the *paired* ratio to one fixed release"
        " (`benchmarks/reference.py`), which a drift of the machine does not affect. In at least"
        " one round the unpaired times must show half of the change."
    )
    yield (
        "- Change points around it are changes of unpaired times. Every round must show the"
        f" change, and all times of the {NEIGHBOURS} releases before it must be below, or"
        f" all of them above, those of the {NEIGHBOURS} releases from it on."
    )
    yield (
        "- Causes are items of MuJoCo's changelog, by commit, unless the text says otherwise"
        " (`benchmarks/causes.toml`)."
    )


def _time_table(history: History, change_points: Sequence[ChangePoint]) -> Iterator[str]:
    columns = [series for series in history.series if series.benchmark in STEP_TIMES]
    columns.sort(key=lambda s: (s.benchmark == BenchmarkName.HEAVY_STEP_TIME, s.label))
    marks = {
        (point.series.params["model"], point.release): "▲" if point.ratio > 1 else "▼"
        for point in change_points
    }
    names = [f"`{series.label}`" for series in columns]
    rows = (
        [version] + [_microseconds(s, version) + marks.get((s.label, version), "") for s in columns]
        for version in history.versions
    )
    return table(["release", *names], rows, right_aligned=names)


def _microseconds(series: Series, version: str) -> str:
    """Return the time of one step; empty where the release was not measured at all."""
    point = series.points.get(version)
    if point is None:
        return ""
    if point.value is None:
        return "failed"
    if not point.is_measured:
        return "–"
    return tables.plain(1e6 * point.value / series.repeats, 3)


def _instructions_table(history: History) -> Iterator[str]:
    columns = [s for s in history.series if s.benchmark == BenchmarkName.INSTRUCTIONS]
    if not columns:
        return iter(["Not counted."])
    columns.sort(key=lambda series: series.label)
    names = [f"`{series.label}`" for series in columns]
    cells = [_instruction_cells(series, history.versions) for series in columns]
    rows = zip(history.versions, *cells, strict=True)
    return table(["release", *names], rows, right_aligned=names)


def _instruction_cells(series: Series, versions: Sequence[str]) -> list[str]:
    """Return a model's thousands of instructions for each release, changes marked."""
    cells = []
    previous = None
    for version in versions:
        point = series.points.get(version)
        if point is None or point.value is None or not point.is_measured:
            cells.append("–")
            continue
        ratio = point.value / previous if previous else 1.0
        mark = ""
        if ratio > 1 + COUNT_THRESHOLD:
            mark = "▲"
        elif ratio < 1 - COUNT_THRESHOLD:
            mark = "▼"
        cells.append(f"{tables.plain(point.value / 1000, 4)}{mark}")
        previous = point.value
    return cells


def _step_table(
    history: History,
    change_points: Sequence[ChangePoint],
    causes: Sequence[Cause],
    threshold: float,
) -> Iterator[str]:
    if not change_points:
        return iter([f"None above {_percent(threshold)}."])
    numbers = ["time, paired", "time, unpaired, by round", "instructions"]
    rows = (_step_row(history, change_point, causes) for change_point in change_points)
    headings = ["release", "model", *numbers, "work", "cause"]
    return table(headings, rows, right_aligned=numbers)


def _step_row(
    history: History, change_point: ChangePoint, causes: Sequence[Cause]
) -> Sequence[str]:
    model = change_point.series.params["model"]
    releases = (change_point.previous, change_point.release)
    instructions = count_ratio(history, model, *releases)
    return (
        change_point.release,
        f"`{model}`",
        change(change_point.ratio),
        ", ".join(change(ratio) for ratio in change_point.rounds),
        "" if instructions is None else change(instructions),
        "; ".join(work_changes(history, model, *releases)) or "the same",
        _cause_text(change_point, causes),
    )


def _other_table(
    change_points: Sequence[ChangePoint], causes: Sequence[Cause], threshold: float
) -> Iterator[str]:
    if not change_points:
        return iter([f"None above {_percent(threshold)}."])
    # One row for a release and benchmark: its parameters usually change together.
    groups: dict[tuple[str, str, bool], list[ChangePoint]] = {}
    for point in change_points:
        key = (point.release, point.series.title, point.ratio > 1)
        groups.setdefault(key, []).append(point)
    rows = (_other_row(group, causes) for group in groups.values())
    headings = ["release", "benchmark", "parameters", "change", "cause"]
    return table(headings, rows, right_aligned=["change"])


def _other_row(group: Sequence[ChangePoint], causes: Sequence[Cause]) -> Sequence[str]:
    ratios = sorted(point.ratio for point in group)
    text = change(ratios[0])
    if len(ratios) > 1:
        text += f" to {change(ratios[-1])}"
    return (
        group[0].release,
        group[0].series.title,
        _labels([point.series.label for point in group]),
        text,
        "; ".join(sorted({_cause_text(point, causes) for point in group})),
    )


def _cause_text(change_point: ChangePoint, causes: Sequence[Cause]) -> str:
    texts = [
        cause.text + (f" (`{cause.commit}`)" if cause.commit else "")
        for cause in explaining(change_point, causes)
    ]
    return "; ".join(texts) or "unknown"


def _work_table(history: History) -> Iterator[str]:
    models = sorted(
        {s.params["model"] for s in history.series if s.benchmark == BenchmarkName.DRIFT}
    )
    rows = []
    for previous, release in pairwise(history.versions):
        changes = {m: work_changes(history, m, previous, release) for m in models}
        texts = [f"`{model}`: {', '.join(texts)}" for model, texts in changes.items() if texts]
        if texts:
            rows.append((release, "<br>".join(texts)))
    return table(["release", "model: what changed"], rows) if rows else iter(["None."])


def _gap_table(history: History) -> Iterator[str]:
    missing = gaps(history)
    if not missing:
        return iter(["None: every benchmark was measured in every release."])
    # One row for a benchmark, a reason and the same releases.
    groups: dict[tuple[str, str, tuple[str, ...]], list[Gap]] = {}
    for gap in missing:
        groups.setdefault((gap.title, gap.reason, gap.versions), []).append(gap)
    rows = (
        (title, _labels([gap.label for gap in group]), reason, _ranges(history, versions))
        for (title, reason, versions), group in groups.items()
    )
    return table(["benchmark", "parameters", "why", "releases"], rows)


def _labels(labels: Sequence[str]) -> str:
    """Return the labels, or their number; a benchmark without parameters has an empty one."""
    if len(labels) > _MOST_LABELS:
        return f"{len(labels)} combinations"
    return "; ".join(label for label in labels if label)


def _ranges(history: History, versions: Sequence[str]) -> str:
    """Return versions, neighbours joined as `first to last`."""
    position = {version: i for i, version in enumerate(history.versions)}
    ranges: list[list[str]] = []
    for version in versions:
        if ranges and position[version] == position[ranges[-1][-1]] + 1:
            ranges[-1].append(version)
        else:
            ranges.append([version])
    return ", ".join(r[0] if len(r) == 1 else f"{r[0]} to {r[-1]}" for r in ranges)


def _percent(share: float) -> str:
    return f"{100 * share:g} %"
