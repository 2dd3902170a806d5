"""Phrases with figures on the pages of the method, from committed files and from the code."""

import json
import math
import statistics
from collections.abc import Callable, Iterator

from commands import ROOT
from committed_trials import trial_counts

from benchmarks.history import change_points, tables
from benchmarks.studies import gpu, tally_file
from benchmarks.studies.odd_programs import ODD_PROGRAMS
from mjbench.commands.compare import accelerated_agreement
from mjbench.commands.compare import accelerated_tolerances as tolerances
from mjbench.commands.env import show as environment
from mjbench.commands.latency import measure as latency
from mjbench.commands.latency import show as latency_section
from mjbench.commands.profile import habit_timing
from mjbench.commands.run import measure, py_spy
from mjbench.commands.run.hook import call_bursts
from mjbench.commands.run.remedies import remedy
from mjbench.commands.tune import reference, solver_convergence, trajectories
from mjbench.commands.tune import result as records
from mjbench.counts import explain
from mjbench.host import conditions, disturbance
from mjbench.measuring import calls, stats
from mjbench.paired import outcomes, race, race_record
from mjbench.releases import placement
from mjbench.simulation import changed_work, engine_clock, starts, workload
from mjbench.simulation.accelerated_judgement import Precision
from mjbench.testing import callables, fixture
from mjbench.verification import plan


def percent(share: float, digits: int = 0) -> str:
    return f"{100 * share:.{digits}f} %"


def readme() -> Iterator[str]:
    for confidence in (race_record.CONFIDENCE, outcomes.CONFIDENCE, records.CONFIDENCE):
        yield f"| {percent(confidence)} |"  # which has which: test_docs


def errors() -> Iterator[str]:
    counts = trial_counts()
    yield from counts.phrases()
    yield f"{counts.missed_injected} that were injected"
    yield f"and {counts.missed_inside} inside a step"
    yield f"A slowdown below `--min-effect` ({percent(outcomes.MIN_EFFECT)})"
    excluded = 100 * (1 - 0.05 ** (1 / counts.alarms_alike.all))
    rate = math.ceil(10 * excluded) / 10
    yield f"No false alarm in {counts.alarms_alike.all} excludes a rate above {rate} %"
    yield f"for a build with itself ({percent(stats.CONFIDENCE)})"
    yield f"cannot show a rate of {percent(1 - outcomes.CONFIDENCE)}"
    yield "for which errors exceed 1 %"  # docs/method/errors.md lists them


def timing() -> Iterator[str]:
    margin = percent(race_record.MARGIN)
    yield f"faster than the fastest by {margin}"
    yield f"or two where those take more than {race.LONG_NS / 1e9:.0f} s"
    yield f"All intervals are at {percent(race_record.CONFIDENCE)}"
    as_good = race_record.AS_GOOD
    slower = f"at most {percent(as_good / 2)} slower by estimate"
    yield f"{slower}, {percent(as_good)} by its whole interval"
    yield f"no other path of the race can be faster by {margin}"
    yield f"faster by {percent(engine_clock.MIN_GAIN)} or more"
    yield f"less than {percent(conditions.ENOUGH_CORES)} of them and is not busy is left out"
    assert (race_record.BUSY_CORES, race.ROUNDS) == (0.25, 4)
    yield "use a quarter of a core or more, a launch has twice as many blocks"
    tally = json.loads((ROOT / "results/busy.json").read_text())
    yield f"({tally['budget_s']:.0f} s a model, {tally['cores']} cores, {tally['cpu']})"
    yield f"{len(tally['outcomes']) // 6} pieces of advice"
    yield f"are within {margin} of the quiet best"
    yield f"the host took {percent(disturbance.NOTABLE_STOLEN)} or more of the processor time"
    tallies = [json.loads((ROOT / f"results/races{n}.json").read_text()) for n in ("", "-foreign")]
    ours, others = (min(model["launches"] for model in tally["models"]) for tally in tallies)
    yield f"launched {ours} times on each of our models, {others} times on others"


def history() -> Iterator[str]:
    """Yield what other tests do not: those run the commands that print the figures."""
    yield f"A *change* of {percent(math.expm1(change_points.MIN_CHANGE))} or more"
    yield f"of at most {percent(change_points._MAX_SLOPE, 1)} each"
    yield f"tables have changes of {percent(math.expm1(tables.MIN_CHANGE))} or more for steps"
    yield f"of {percent(math.expm1(tables.MIN_OPERATION_CHANGE))} or more for operations"
    page = " ".join((ROOT / "docs/method/history.md").read_text().split())
    start, end = page.index("## How exact it is"), page.index("## Which changes are listed")
    yield page[start:end]  # tests/benchmarks/history/test_committed_history.py


def paired() -> Iterator[str]:
    yield f"differ by more than {percent(changed_work.SAME_WORK, 1)}"
    yield f"`--min-effect` ({percent(outcomes.MIN_EFFECT)})"
    yield "does not contain 0 %"
    yield "and the estimate is at least half of `--min-effect`"
    yield f"at most {percent(1 - outcomes.CONFIDENCE)} are expected to be false alarms"


def run() -> Iterator[str]:
    calls_of_burst = call_bursts.BURST_CALLS
    yield f"**In bursts** of {calls_of_burst} calls, or of 0.1 s"
    cost = percent(call_bursts.MAX_COST_SHARE, 1)
    yield f"at most {cost} of the processor time after the first 10 ms"
    yield f"{py_spy.DEFAULT_RATE_HZ:.0f} times a second"
    yield f"from {percent(remedy.LEAST_GAIN)} of the loop on"
    yield f"savings of {percent(remedy.LEAST_GAIN)} of the loop or more"
    yield f"A saving whose {percent(stats.CONFIDENCE)} interval includes 0"
    yield f"runs again for up to {measure.SECOND_S:.0f} s"
    yield f"runs {len(ODD_PROGRAMS)} programs under Python alone"


def tune() -> Iterator[str]:
    yield f"the whole {percent(records.CONFIDENCE)} interval"
    yield f"by at most {percent(reference.SAME_SHARE, 3)} of the motion"
    yield f"by more than {percent(trajectories.SENSOR_SHARE)} of its largest value"
    yield f"in more than {percent(solver_convergence.MOST_LIMITED)} of the steps"
    yield f"With {percent(records.CONFIDENCE)} confidence, nine runs in ten"
    same, none = percent(records.SAME_ERROR), percent(records.NO_ERROR, 1)
    yield f"{same} more counts as the same, and {none} of the motion counts as none"


def work() -> Iterator[str]:
    yield f"{starts.KEYFRAME_SETTLE_S} s from a keyframe"
    yield f"{starts.DEFAULT_SETTLE_S:.0f} s without one"
    yield f"a correlation time of {workload.CONTROL_TIME_S} s"
    yield f"The default is {plan.NBATCH} × {plan.NSTEP}"
    yield f"more than {1000 * plan.LONG_BLOCK_S:.0f} ms"


def loop() -> Iterator[str]:
    yield f"Student's {percent(habit_timing.CONFIDENCE)} interval"
    median, high, higher = (f"{100 * quantile:g} %" for quantile in latency.QUANTILES)
    yield f"which latency {median}, {high} and {higher} of the ticks do not exceed"
    yield f"sleeps until {latency.SPIN_NS / 1e6:g} ms before a paced tick"
    yield f"For the slowest {percent(1 - latency.SLOW)}"
    yield f"({latency_section._FACTOR} times as much"
    yield f"differ by less than {percent(explain.REPEATABILITY, 1)}"


def python() -> Iterator[str]:
    yield f"in blocks of at least {1000 * calls.BLOCK_S:g} ms"
    yield f"`time_limit_s` ({fixture.TIME_LIMIT_S:.0f} seconds)"
    yield f"(at a confidence of {percent(outcomes.CONFIDENCE)})"
    yield f"`max_slowdown`, {percent(fixture.MAX_SLOWDOWN)} by default"
    yield f"by a standard deviation of {percent(callables.PROCESS_SPREAD)}"
    least = callables.least_slowdown(outcomes.CONFIDENCE)
    yield f"so a `max_slowdown` below {percent(least, 1)} is refused"


def accelerated() -> Iterator[str]:
    states, simulations = accelerated_agreement.JUDGED_STATES, accelerated_agreement.FOLLOWED
    yield f"up to {states} states of {simulations} simulations"
    yield f"at most {percent(tolerances.MAX_ROUNDING_EFFECT, 1)}"
    yield f"ten times C's, or {percent(tolerances.SETTINGS_LIMIT, 1)}"
    yield f"within {percent(tolerances.TOGETHER_SHARE)} of C"
    yield f"the same, or {percent(tolerances.FIGURE_ROUNDING[Precision.FLOAT32], 1)}"
    yield f"more than {percent(tolerances.ONE_ANSWER_EFFECT, 1)} off for spheres"
    yield f"more than {percent(tolerances.LACKING_EFFECT)} off, with points missing"
    yield f"less than {percent(tolerances.CLOSE_EFFECT)} off in nine of ten states"
    yield from on_gpu()
    yield "a force off by 1 %"  # planted by tests/commands/compare/test_accelerated_agreement.py


def on_gpu() -> Iterator[str]:
    """On an H100, `humanoid`."""
    tally = tally_file.load(gpu.RESULTS / "gpu.json", gpu.GpuTally, "a GPU")
    timed = {row.starts: row for row in tally.over_by_hand if row.path_ns_per_step is not None}
    own, other = timed[gpu.Starts.STORED], timed[gpu.Starts.TESTSPEED]
    warp_ns, other_ns = own.path_ns_per_step, other.path_ns_per_step
    assert warp_ns is not None
    assert other_ns is not None
    (by_step,) = (speed.steps_ns for speed in tally.testspeed if speed.steps_ns)
    yield (
        f"| testspeed's | {other_ns:.0f} | {other_ns * other.ratio:.0f}"
        f" | {statistics.median(by_step):.0f} |"
    )
    yield f"| our benchmarks' | {warp_ns:.0f} | {warp_ns * own.ratio:.0f} |"


PHRASES: dict[str, Callable[[], Iterator[str]]] = {
    "docs/method/README.md": readme,
    "docs/method/accelerated.md": accelerated,
    "docs/method/c.md": lambda: iter(()),
    "docs/method/environments.md": lambda: iter(
        (f"by more than {percent(environment.SUM_TOLERANCE)}",)
    ),
    "docs/method/errors.md": errors,
    "docs/method/history.md": history,
    "docs/method/loop.md": loop,
    "docs/method/paired.md": paired,
    "docs/method/placement.md": lambda: iter(
        (f"whole lines within {placement.HUGE_PAGE_BYTES >> 20} MiB",)
    ),
    "docs/method/run.md": run,
    "docs/method/timing.md": timing,
    "docs/method/tune.md": tune,
    "docs/method/work.md": work,
    "docs/python.md": python,
}
