"""What `mjbench profile` comes to: where a step's time goes."""

from collections.abc import Iterator, Mapping, Sequence

from mjbench import formats
from mjbench.commands.profile import model_costs, step_parts
from mjbench.commands.profile.measure import FRAMES_PER_S, ProfiledSteps, ProfileRow
from mjbench.commands.profile.model_costs import Cost
from mjbench.commands.profile.rendering import FrameTime
from mjbench.commands.profile.step_parts import Stage
from mjbench.formats import duration, plain
from mjbench.results import charts, content
from mjbench.results.content import Column, Conclusion, DataTable, Section, Tone
from mjbench.results.starts import starts_lines
from mjbench.simulation import engine_clock
from mjbench.simulation.engine_warnings import warning_lines

# From this share of a step on, what is left is explained.
_NOTABLE_OTHER = 0.05
_NEXT = "`mjbench tune` looks for faster settings, `mjbench compare` for a faster way to step"
_UNRESOLVED = "below what was resolved"


def sections(rows: Sequence[ProfileRow]) -> Iterator[Section]:
    for row in rows:
        steps = row.steps
        if steps is None:
            yield content.failure(row.model, row.status, row.detail)
            continue
        stages = _stages(steps)
        title = f"{row.model}: stages of a step"
        has_controls = steps.run_nstep and steps.work.actuators != 0
        held = ["Each simulation holds the controls of its start"] if has_controls else []
        yield Section(
            heading=f"{row.model}: where a step's time goes",
            conclusions=[*conclusions(row.model, steps)],
            facts=[
                work_line(steps),
                *starts_lines(steps.starts, with_warnings=False),
                *held,
                *warning_lines(steps.warnings),
            ],
            figures=[charts.share_bars(title, stages, "stages", "ns", "ns of a step")],
            tables=[stages, costs_table(steps.costs), _simulated_second(row.simulated_second)],
            notes=[
                *_other_line(steps),
                *(_frame_line(frame, steps.loop_ns) for frame in row.frames or ()),
                _NEXT,
            ],
        )


def conclusions(model: str, steps: ProfiledSteps) -> Iterator[Conclusion]:
    """Yield how long a step takes, where, and what the timer of MuJoCo's Python package takes."""
    parts = (
        f"all of it the engine; Python's part is {_UNRESOLVED}"
        if steps.is_all_engine
        else f"engine {duration(steps.engine_ns)} ({100 * steps.engine_ns / steps.loop_ns:.0f} %),"
        f" Python {duration(steps.python_ns)}"
    )
    yield Conclusion(f"{model}: a step of a Python loop takes {duration(steps.loop_ns)}: {parts}")
    stage, share = step_parts.longest(steps.stages)
    if share > 0:
        of_engine = f"{formats.short_percent(share)} of the engine's time"
        cost = model_costs.main_cost(steps.stages, steps.costs)
        most = f"; most of it is {cost}" if cost is not None else ""
        yield Conclusion(f"{model}: the longest stage is {stage}, {of_engine}{most}")
    gain = steps.speedup_without_timer
    if gain is not None and gain.is_above(1.0) and gain.estimate >= 1 + engine_clock.MIN_GAIN:
        yield Conclusion(
            f"{model}: without {engine_clock.TIMER_NAME}, a step of the loop is"
            f" {formats.with_interval(gain)} times as fast. {engine_clock.OFF_NOTE}",
            Tone.UNSURE,
        )


def work_line(steps: ProfiledSteps) -> str:
    work = steps.work
    return (
        f"A step has {plain(work.contacts, 3)} contacts, {plain(work.constraints, 3)} constraints,"
        f" {plain(work.solver_iterations, 3)} solver iterations"
    )


def _stages(steps: ProfiledSteps) -> DataTable:
    stages = sorted(steps.stages.items(), key=lambda item: -item[1])
    return DataTable.of(
        "Stages of a step",
        [(stage, share) for stage, share in stages if share > 0],
        (Column("stage"), lambda row: row[0]),
        (Column("of a step", formats.percent), lambda row: row[1]),
        (Column("ns", formats.digits(4)), lambda row: row[1] * steps.engine_ns),
        (Column("", is_bar=True), lambda row: formats.bar(row[1])),
    )


def costs_table(costs: Sequence[Cost]) -> DataTable:
    return DataTable.of(
        "Parts of the model",
        costs,
        (Column("part of the model"), lambda cost: cost.name),
        (Column("kind"), lambda cost: cost.kind.value),
        (Column("number", formats.count), lambda cost: cost.count),
        (Column("of a step", formats.whole_percent), lambda cost: cost.share),
    )


def _other_line(steps: ProfiledSteps) -> Iterator[str]:
    share = steps.stages.get(Stage.OTHER, 0.0)
    if share >= _NOTABLE_OTHER:
        yield (
            f"Other ({formats.short_percent(share)}) is what neither the engine's timers nor calls"
            " of its functions explain, such as what lies between stages, callbacks with the"
            " timer of MuJoCo's Python package, and what caches lose; `mjbench profile"
            " --instructions` names the functions"
        )


def _frame_line(frame: FrameTime, loop_ns: float) -> str:
    if frame.seconds is None:
        return f"Rendering by {frame.backend}: not available ({frame.detail})"
    frame_ns = 1e9 * frame.seconds
    return (
        f"Rendering a frame of {frame.width} × {frame.height} by {frame.backend}:"
        f" {duration(frame_ns)}, as long as {frame_ns / loop_ns:,.0f} steps"
    )


def _simulated_second(parts: Mapping[str, float]) -> DataTable:
    longest = max([1e-12, *parts.values()])
    return DataTable.of(
        f"A second of simulated time, with {FRAMES_PER_S} frames",
        parts.items(),
        (Column("part"), lambda row: row[0]),
        (
            Column("takes", lambda ns: duration(ns) if ns > 0 else _UNRESOLVED),
            lambda row: 1e9 * row[1],
        ),
        (
            Column("", is_bar=True),
            lambda row: formats.bar(max(0.0, row[1]) / longest) or formats.bar(0.02),
        ),
    )
