"""`mjbench doctor`: what on this machine spoils measurements."""

import sys
from typing import TYPE_CHECKING

from mjbench.cli.context import RunContext
from mjbench.cli.group import cli
from mjbench.cli.shared import JSON, budget, mode
from mjbench.simulation import models
from mjbench.status import ExitCode

# Seconds after which a backend that renders nothing does not work.
_FRAME_LIMIT_S = 20.0

if TYPE_CHECKING:
    from collections.abc import Iterator

    from mjbench.host.conditions import Condition
    from mjbench.report.doctor import NoiseRow


@cli.command()
@mode("--verdicts", "How often are verdicts wrong on this machine?")
@mode("--placement", "How far does speed depend on where MuJoCo's code lies in memory?")
@budget(12, "Time for comparing the cart-pole with itself.")
@JSON
def doctor(budget_s: float, json_file: str | None) -> None:
    """What on this machine spoils measurements, and how small a change can it decide?

    It looks at the processor, its clock, the load, the host, Python, valgrind and rendering, and
    then compares the cart-pole with itself. Exit code 1: something is bad, or changes of 1 %
    cannot be decided within a minute. --verdicts and --placement take its place, and
    much longer.

    \b
    Example:
      mjbench doctor && mjbench versions 3.17.0 4.0.0 robot.xml --fail-on slower
    """
    from mjbench.host import conditions, machine
    from mjbench.host.neighbours import Presence
    from mjbench.pages.terminal import print_lines
    from mjbench.report.doctor import condition_lines, noise_section
    from mjbench.report.documents import DoctorDocument

    with Presence("doctor") as presence, RunContext(json_file) as run:
        others = presence.enter(wait=False)
        rows = [*conditions.all_conditions(others), *_mujoco_conditions()]
        print_lines(run.out, [*condition_lines(rows)])
        noise = _noise(budget_s)
        run.show([noise_section(noise, rows)])
        run.write(DoctorDocument(machine=machine.describe(), conditions=rows, noise=noise))
    if noise.decidable is None:
        sys.exit(ExitCode.ENVIRONMENT)
    is_fit = noise.trusted and all(row.grade != conditions.Grade.BAD for row in rows)
    sys.exit(ExitCode.OK if is_fit else ExitCode.FINDING)


def _mujoco_conditions() -> "Iterator[Condition]":
    from mjbench.counts import instructions
    from mjbench.host.conditions import Condition, Grade
    from mjbench.paired import machine_check
    from mjbench.simulation import package_timer

    share = machine_check.clock_share()
    if share is not None:
        detail = f"takes {100 * share:.0f} % of a cart-pole's step"
        yield Condition("MuJoCo's timer", Grade.NOTE, detail, package_timer.OFF_NOTE)
    missing = instructions.unavailable()
    if missing:
        yield Condition("valgrind", Grade.NOTE, "is missing", missing)
    else:
        yield Condition("valgrind", Grade.GOOD, "is there: instructions can be counted")
    yield _rendering()


def _rendering() -> "Condition":
    from mjbench.host.conditions import Condition, Grade
    from mjbench.loop import rendering

    source = models.resolve("cartpole")
    frames = [rendering.measure(source, name, _FRAME_LIMIT_S) for name in rendering.BACKENDS]
    speeds = [f"{f.backend} {1e3 * f.seconds:.1f} ms a frame" for f in frames if f.seconds]
    if speeds:
        return Condition("rendering", Grade.GOOD, f"works: {', '.join(speeds)}")
    reasons = "; ".join(f"{frame.backend}: {frame.detail}" for frame in frames)
    return Condition("rendering", Grade.NOTE, "does not work", reasons)


def _noise(budget_s: float) -> "NoiseRow":
    from mjbench.errors import MjbenchError
    from mjbench.paired import machine_check
    from mjbench.paired.worker_pool import WorkerPool
    from mjbench.report.doctor import NoiseRow

    try:
        with WorkerPool() as pool:
            return NoiseRow.of(machine_check.noise(pool, budget_s))
    except MjbenchError as error:
        return NoiseRow(detail=str(error))
