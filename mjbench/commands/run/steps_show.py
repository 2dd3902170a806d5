"""How fast a program steps, which parts of its model cost most, and what observing it took."""

from collections.abc import Iterator, Mapping

from mjbench import formats
from mjbench.commands.profile.show import costs_table
from mjbench.commands.profile.step_parts import Stage
from mjbench.commands.run.physics_cost import PhysicsCost
from mjbench.commands.run.result import ProgramRow
from mjbench.commands.run.step_times import StepTimes
from mjbench.formats import duration, plain, whole_percent
from mjbench.results.content import Column, DataTable, Section, filled
from mjbench.status import Status

# What a timer of the engine holds beside its stage; only calls tell them apart.
_OF_TIMERS: Mapping[str, str] = {Stage.KINEMATICS: f"{Stage.KINEMATICS} and {Stage.TENDONS}"}
# Smaller shares of a step are left out of the line; the JSON document has all.
_LEAST_STAGE = 0.03
# Observing should cost no more; beyond it, the report says how to make it cost less.
MAX_COST = 0.03
# Of a program that ends sooner, what starting costs says nothing of the rest.
LEAST_WALL_S = 1.0


def steps_section(row: ProgramRow) -> Iterator[Section]:
    """Yield how fast the program steps, which parts of the model cost most, and what limits this.

    Of several processes it has the one with most steps: others that do the same would repeat it.
    """
    if row.status != Status.OK:
        return
    steps = max(row.steps, key=lambda each: each.nstep, default=None)
    of_steps = [] if steps is None else _step_lines(steps, len(row.steps), row.physics)
    durations = [] if steps is None else [_durations_table(steps)]
    facts = [*of_steps, *filter(None, [gil_wait(row)])]
    tables = filled(costs_table(row.physics.costs if row.physics is not None else ()), *durations)
    heading = "steps" if facts or tables else "observation"  # JAX takes steps that nobody counts
    notes = [_cost_line(row)] if row.wall_s >= LEAST_WALL_S else []
    if facts or tables or notes:
        yield Section(f"{row.program}: {heading}", facts=facts, tables=tables, notes=notes)


def _step_lines(steps: StepTimes, processes: int, physics: PhysicsCost | None) -> list[str]:
    of = f" in the process with most of {processes}" if processes > 1 else ""
    lines = []
    if steps.steps_per_s is not None and steps.real_time_factor is not None:
        lines.append(
            f"Steps{of}: {steps.steps_per_s:,.0f} per second,"
            f" {plain(steps.real_time_factor, 3)} × real time"
        )
    if processes > 1 and steps.startup_s > 0:
        lines.append(f"It began to step {plain(steps.startup_s, 2)} s after its start.")
    stages, names = (steps.stages, _OF_TIMERS) if physics is None else (physics.stages, {})
    if stages:
        largest = sorted(stages.items(), key=lambda item: -item[1])
        parts = [
            f"{names.get(stage, stage)} {whole_percent(share)}"
            for stage, share in largest
            if share >= _LEAST_STAGE
        ]
        lines.append(f"Stages of the engine: {', '.join(parts)}")
    return lines


def _durations_table(steps: StepTimes) -> DataTable:
    iteration = "step of the environment" if steps.of_environment else "iteration"
    timed = [("engine's step", steps.step), (iteration, steps.iteration)]
    return DataTable.of(
        "Times of steps",
        [(name, durations) for name, durations in timed if durations is not None],
        (Column("of"), lambda row: row[0]),
        (Column("timed", formats.count), lambda row: row[1].count),
        (Column("p50", duration), lambda row: row[1].p50_ns),
        (Column("p99", duration), lambda row: row[1].p99_ns),
        (Column("max", duration), lambda row: row[1].max_ns),
    )


def gil_wait(row: ProgramRow) -> str:
    """Return which thread waits longest for the GIL, and for which thread; "" where none does."""
    if not row.gil_waits:
        return ""
    wait = row.gil_waits[0]
    others = len(row.gil_waits) - 1
    also = f"; {others} more wait, too" if others else ""
    return (
        f"Threads: at least {whole_percent(wait.share)} of the time of {wait.thread} waits for the"
        f" GIL{also}; {wait.holder} holds it for {whole_percent(wait.holder_share)} of the time,"
        f" most often at {wait.place}. mujoco.rollout and mujoco.batch.Batch step on threads"
        " without the GIL, and each process has a GIL of its own."
    )


def _cost_line(row: ProgramRow) -> str:
    line = f"Observing took {cost(row)} of the program's time."
    if row.cost_share > MAX_COST:
        line += f" --sample-rate {max(1, row.rate_hz // 2)} makes it less."
    return line


def cost(row: ProgramRow) -> str:
    """Return what observing cost the program; of several processes, at least that much.

    Where processes wait for each other, all of them lose what one loses (docs/method/run.md).
    """
    return f"{'at least ' if len(row.steps) > 1 else ''}{formats.percent(row.cost_share)}"
