"""The page of `mjbench profile`: where a step's time goes."""

from typing import Any

from rich.console import Console
from rich.markup import escape

from mjbench.loop import profile as room
from mjbench.loop.profile import StepProfile
from mjbench.report import tables

_WIDTH = 30
# Less of a step than this is not told of the engine's clock.
_CLOCK_PERCENT = 2


def print_profile(out: Console, found: StepProfile) -> None:
    """Print a model's page."""
    engine, loop = found.engine_ns, found.loop_ns
    out.print(
        f"\n[bold]{escape(found.model)}[/bold]: a step of a Python loop takes {_time(loop)}:"
        f" engine {_time(engine)} ({100 * engine / loop:.0f} %), Python {_time(loop - engine)}",
        soft_wrap=True,
    )
    counts = ", ".join(
        f"{value:.3g} {name.replace('_', ' ')}" for name, value in found.work.items()
    )
    out.print(f"A step has {counts}.", soft_wrap=True)
    share = 100 * (found.clock_ns or 0.0) / loop
    if share >= _CLOCK_PERCENT:
        out.print(
            f"The engine's own clock, which these timers need, is {share:.0f} % of it"
            f" ({_time(found.clock_ns or 0.0)}); `mjbench overhead --code` shows how to turn it"
            " off.",
            soft_wrap=True,
        )
    table = tables.plain_table(["stage", "of a step", "time", ""], right=(1, 2))
    for stage, share in sorted(found.stages.items(), key=lambda item: -item[1]):
        if share > 0:
            bar = "█" * round(_WIDTH * share)
            table.add_row(stage, f"{100 * share:.1f} %", _time(share * engine), bar)
    out.print(table)
    for frame in found.frames:
        size = f"{room.WIDTH} × {room.HEIGHT}"
        if frame.seconds is None:
            out.print(
                escape(f"Rendering by {frame.backend}: not available ({frame.detail})"),
                soft_wrap=True,
            )
            continue
        steps = 1e9 * frame.seconds / loop
        out.print(
            f"Rendering a frame of {size} by {frame.backend}: {_time(1e9 * frame.seconds)}, as"
            f" long as {steps:,.0f} steps",
            soft_wrap=True,
        )
    out.print(f"A second of simulated time, with {room.FRAMES_PER_S} frames:")
    sides = tables.plain_table(["", "takes", ""], right=(1,))
    parts = found.simulated_second()
    longest = max(parts.values())
    for name, seconds in parts.items():
        sides.add_row(name, _time(1e9 * seconds), "█" * max(1, round(_WIDTH * seconds / longest)))
    out.print(sides)


def as_result(found: StepProfile) -> dict[str, Any]:
    """Return what `mjbench profile --json` gives of one model."""
    return {
        "model": found.model,
        "timestep": found.timestep,
        "loop_ns": found.loop_ns,
        "engine_ns": found.engine_ns,
        "python_ns": found.python_ns,
        "clock_ns": found.clock_ns,
        "work": dict(found.work),
        "stages": dict(found.stages),
        "frames": [
            {
                "backend": frame.backend,
                "width": room.WIDTH,
                "height": room.HEIGHT,
                "seconds": frame.seconds,
                "detail": frame.detail,
            }
            for frame in found.frames
        ],
        "simulated_second": found.simulated_second(),
    }


def _time(ns: float) -> str:
    for unit, size in (("s", 1e9), ("ms", 1e6), ("µs", 1e3)):
        if abs(ns) >= size:
            return f"{ns / size:.3g} {unit}"
    return f"{ns:.0f} ns"
