"""What docs/results.md has of committed runs: ten models in a table and a chart, and the releases.

`python -m benchmarks.studies.results_page` writes it again from results/runs and results/history.
"""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from benchmarks.studies.page_part import DOCS, PagePart
from mjbench.interval import Interval
from mjbench.paired.outcomes import Cause
from mjbench.paired.race_record import Loop
from mjbench.results import markdown

if TYPE_CHECKING:  # else imported late: asv imports this module where few packages are
    from benchmarks.history.speed_history import Listed, SpeedHistory
    from benchmarks.history.speed_series import MeasuredRelease
    from mjbench.commands.compare.advice import Advice
    from mjbench.commands.compare.results import ModelResults
    from mjbench.results.runs import Run

ROOT = Path(__file__).resolve().parents[2]
RUN = ROOT / "results/runs/reference-mujoco-4.0.0.jsonl"
CHART = DOCS / "results.svg"
MODELS = PagePart("results.md", "models", "benchmarks.studies.results_page")
RELEASES = PagePart("results.md", "releases", "benchmarks.studies.results_page")
# Whose releases are listed, and from which change of any of them on.
SERIES, LEAST = ("humanoid", "pick_and_place", "cartpole"), 0.02
# A figure from fewer launches is cited with their number.
ENOUGH_LAUNCHES = 8
_COLOURS = {Loop.CLOSED: "#d9730d", Loop.OPEN: "#2a78b8"}
_NAMES = {Loop.CLOSED: "for RL (closed loop)", Loop.OPEN: "for planning (open loop)"}
_LEFT, _ROW, _UNIT, _MOST = 150, 34, 170, 3.0


def committed_run() -> "Run":
    """Return the run of all shipped models."""
    from mjbench.commands.show.kinds import RECORD_TYPES
    from mjbench.results import runs

    return runs.load(RUN, RECORD_TYPES)


def committed_history() -> "SpeedHistory":
    """Return the committed history of releases."""
    from benchmarks.history import files, known_causes

    committed = files.run_files(ROOT / "results/history")
    return files.read([f for f in committed if "reference-" in f.name], known_causes.FILE)


def model_lines(run: "Run") -> Iterator[str]:
    """Yield the table of what is advised on each model."""
    machine = run.header.machine
    yield (
        f"MuJoCo {machine.versions['mujoco']} on {machine.usable_cores} cores of {machine.cpu}: the"
        " fastest way of stepping, and its speed-up over a plain Python loop with a 95 % interval."
        f" `?` marks advice that is not certain. Fewer than {ENOUGH_LAUNCHES} launches are named."
    )
    yield ""
    columns = ["plain loop, µs/step", *_NAMES.values()]
    rows = ([m.model.model, _plain_us(m), *map(_cell, _advised(m))] for m in _models(run))
    yield from markdown.table_lines(["model", *columns], rows, columns[:1])


def _models(run: "Run") -> "list[ModelResults]":
    from mjbench.commands.compare.results import derive_all

    return list(derive_all(run.records))


def _advised(model: "ModelResults") -> "list[Advice]":
    rows = {row.loop: row for row in model.advice}
    return [rows[loop] for loop in _NAMES]


def _plain_us(model: "ModelResults") -> str:
    (plain,) = [r for r in model.results if r.path == "python_loop" and not r.options]
    assert plain.step_ns is not None
    us = plain.step_ns / 1e3
    return f"{us:,.0f}" if us >= 100 else f"{us:.3g}"


def _cell(row: "Advice") -> str:
    if row.speedup is None:
        return "the plain loop"
    from mjbench.commands.compare.advice import described

    mark = "" if row.is_certain else " ?"
    if row.result.launches < ENOUGH_LAUNCHES:
        mark = f", {row.result.launches} launches{mark}"
    return f"{described(row.variant)}: {_interval(row.speedup)}{mark}"


def _interval(ratio: Interval) -> str:
    return f"{ratio.estimate:.2f} ({ratio.low:.2f}–{ratio.high:.2f})"


def chart(run: "Run") -> str:
    """Return the speed-ups of the table as an SVG image: a dot for each, with its interval."""
    models = _models(run)
    height = _ROW * len(models) + 70
    parts = [_legend(), *_axis(height - 40)]
    for i, model in enumerate(models):
        middle = 40 + _ROW * (i + 0.5)
        parts.append(_text(_LEFT - 12, middle + 4, model.model.model, "end"))
        for row, offset in zip(_advised(model), (-5, 5), strict=True):
            parts.extend(_mark(row, middle + offset))
    width = round(_x(_MOST)) + 30
    return "\n".join(
        [
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}"'
            ' font-family="sans-serif" font-size="13" fill="#777">',
            "<title>Speed-up of the advised path over a plain Python loop, by model</title>",
            *parts,
            "</svg>\n",
        ]
    )


def _x(speedup: float) -> float:
    return _LEFT + _UNIT * speedup


def _text(x: float, y: float, text: str, anchor: str = "start") -> str:
    return f'<text x="{x:.0f}" y="{y:.0f}" text-anchor="{anchor}">{text}</text>'


def _legend() -> str:
    entries = enumerate(_NAMES.items())
    return "".join(
        f'<circle cx="{_LEFT + 220 * i}" cy="16" r="4" fill="{_COLOURS[loop]}"/>'
        f"{_text(_LEFT + 220 * i + 10, 20, name)}"
        for i, (loop, name) in entries
    )


def _axis(bottom: float) -> Iterator[str]:
    for tick in range(math.floor(_MOST) + 1):
        dash = "" if tick == 1 else ' stroke-dasharray="2 4"'
        yield (
            f'<line x1="{_x(tick):.0f}" x2="{_x(tick):.0f}" y1="34" y2="{bottom:.0f}"'
            f' stroke="#999"{dash}/>'
        )
        yield _text(_x(tick), bottom + 18, f"{tick}×", "middle")


def _mark(row: "Advice", y: float) -> Iterator[str]:
    speedup = row.speedup or Interval(1.0, 1.0, 1.0)
    colour = _COLOURS[row.loop]
    low, high = speedup.low or speedup.estimate, speedup.high or speedup.estimate
    yield (
        f'<line x1="{_x(low):.1f}" x2="{_x(high):.1f}" y1="{y:.0f}" y2="{y:.0f}"'
        f' stroke="{colour}" stroke-width="3"/>'
    )
    yield f'<circle cx="{_x(speedup.estimate):.1f}" cy="{y:.0f}" r="4" fill="{colour}"/>'


def release_lines(history: "SpeedHistory") -> Iterator[str]:
    """Yield the releases in which one of the models became slower or faster."""
    from benchmarks.history.speed_history import listed_changes

    series = [each for each in history.models if each.name in SERIES]
    changes: dict[str, dict[str, Listed]] = {}
    for listed in listed_changes(history, series):
        changes.setdefault(listed.after.release, {})[listed.series.name] = listed
    of_release = {each.name: {m.release: m for m in each.measured} for each in series}
    rows = []
    for release in history.releases():
        of_models = changes.get(release, {})
        if any(abs(each.point.change) >= LEAST for each in of_models.values()):
            cells = (_change(of_models.get(name), of_release[name][release]) for name in SERIES)
            rows.append([release, *cells])
    yield (
        f"Releases in which a step of one of three models changed by {100 * LEAST:g} % or more."
        " Positive is slower. *Work* means that the step computes something different. In brackets"
        " is the time of a step over that of 4.0.0."
    )
    yield ""
    yield from markdown.table_lines(["release", *SERIES], rows)


def _change(listed: "Listed | None", measured: "MeasuredRelease") -> str:
    over_newest = f"({math.exp(measured.ratio.log_ratio):.2f})"
    if listed is None:
        return over_newest
    work = " *work*" if listed.cause == Cause.WORK else ""
    return f"{100 * math.expm1(listed.point.change):+.1f} %{work} {over_newest}"


def main() -> None:
    """Write the parts of the page, and the chart."""
    run = committed_run()
    MODELS.write(model_lines(run))
    RELEASES.write(release_lines(committed_history()))
    CHART.write_text(chart(run), encoding="utf-8")


if __name__ == "__main__":
    main()
