"""What `mjbench profile` prints: where a step's time goes."""

from rich.console import Console

from mjbench.instrument.units import duration
from mjbench.loop.profile import FRAMES_PER_S, StepProfile, StepTimes
from mjbench.loop.rendering import FrameTime
from mjbench.report import tables
from mjbench.report.starts import starts_lines
from mjbench.simulation import package_timer

_WIDTH = 30


def print_profile(out: Console, profile: StepProfile) -> None:
    """Print a model's profile: its step, the stages, rendering, and a simulated second."""
    _print_step(out, profile)
    _print_stages(out, profile)
    for frame in profile.frames:
        _print_frame(out, frame, profile.steps.loop_ns)
    _print_simulated_second(out, profile)


def _print_step(out: Console, profile: StepProfile) -> None:
    steps = profile.steps
    loop_ns, engine_ns, clock_ns = steps.loop_ns, steps.engine_ns, steps.clock_ns or 0.0
    out.print(
        tables.headed(
            f"\n{profile.model}",
            f": a step of a Python loop takes {duration(loop_ns)}: engine {duration(engine_ns)}"
            f" ({100 * engine_ns / loop_ns:.0f} %), Python {duration(profile.python_ns)}",
        ),
        soft_wrap=True,
    )
    work = steps.work
    out.print(
        f"A step has {tables.plain(work.contacts, 3)} contacts,"
        f" {tables.plain(work.constraints, 3)} constraints,"
        f" {tables.plain(work.solver_iterations, 3)} solver iterations.",
        soft_wrap=True,
    )
    for line in _starts_lines(steps):
        out.print(line, soft_wrap=True)
    for line in tables.warning_lines(steps.warnings):
        out.print(line, soft_wrap=True)
    if clock_ns / loop_ns >= package_timer.MIN_GAIN:
        out.print(
            f"Of it, {package_timer.NAME} takes {100 * clock_ns / loop_ns:.0f} %"
            f" ({duration(clock_ns)}). You can turn it off. {package_timer.OFF_NOTE}",
            soft_wrap=True,
        )


def _starts_lines(steps: StepTimes) -> list[str]:
    """Return which states were stepped, where they are the user's own."""
    lines = starts_lines(steps.starts, with_warnings=False)
    if steps.run_nstep:
        lines.append("Each run holds the controls of its start")
    return lines


def _print_stages(out: Console, profile: StepProfile) -> None:
    table = tables.plain_table(["stage", "of a step", "time", ""], right=(1, 2))
    for stage, share in sorted(profile.steps.stages.items(), key=lambda item: -item[1]):
        if share > 0:
            bar = "█" * round(_WIDTH * share)
            table.add_row(
                stage, f"{100 * share:.1f} %", duration(share * profile.steps.engine_ns), bar
            )
    out.print(table)


def _print_frame(out: Console, frame: FrameTime, loop_ns: float) -> None:
    if frame.seconds is None:
        text = f"Rendering by {frame.backend}: not available ({frame.detail})"
    else:
        frame_ns = 1e9 * frame.seconds
        text = (
            f"Rendering a frame of {frame.width} × {frame.height} by {frame.backend}:"
            f" {duration(frame_ns)}, as long as {frame_ns / loop_ns:,.0f} steps"
        )
    out.print(text, soft_wrap=True)


def _print_simulated_second(out: Console, profile: StepProfile) -> None:
    out.print(f"A second of simulated time, with {FRAMES_PER_S} frames:")
    table = tables.plain_table(["", "takes", ""], right=(1,))
    parts = profile.simulated_second()
    longest = max(parts.values())
    for name, seconds in parts.items():
        table.add_row(
            name, duration(1e9 * seconds), "█" * max(1, round(_WIDTH * seconds / longest))
        )
    out.print(table)
