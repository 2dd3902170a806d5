"""What each habit of a Python loop costs for one model: `mjbench overhead`.

Each launch is a process of its own that times every source (habits.py) in quads with the bare
loop. The launch gives one number for a source, the median over quads of the difference per step;
the interval is Student's t over launches, which differ by memory layout.
"""

import random
import statistics
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mjbench.errors import InputError, MachineError
from mjbench.instrument import isolate
from mjbench.instrument.isolate import Channel
from mjbench.simulation.models import ModelSource

# A block of the bare loop, in seconds; quads of each source in a launch; launches.
BLOCK_S, QUADS, LAUNCHES = 0.001, 12, 6
LEAST_NSTEP = 10
CONFIDENCE = 0.95
_NSTEP = "steps of a run"
# The parts of the bare loop: a call that steps nothing, which is no habit, and one call for all.
BINDING, ENGINE = "call of zero steps", "one call for all steps"
CLOCK = "engine clock off"


@dataclass(frozen=True)
class Cost:
    """What a source adds to a step.

    Attributes:
      source: its name.
      ns: added to each step.
      low: lower end of the interval.
      high: upper end of the interval.
      share: of this model's bare step.
      cheaper: the source that does the same for less; empty where there is none.
      saved_ns: by writing it the cheaper way; None where there is none.
      code: the loop with it inside.
    """

    source: str
    ns: float
    low: float
    high: float
    share: float
    cheaper: str
    saved_ns: float | None
    code: str


@dataclass(frozen=True)
class Table:
    """What the habits cost for one model.

    Attributes:
      model: its name.
      bare_ns: one step of the bare loop.
      engine_ns: one step in a call for many steps.
      binding_ns: a call that steps nothing, made beside a step.
      nstep: steps of a run of the loop, which is an episode; the median over launches.
      costs: by source, the dearest first.
    """

    model: str
    bare_ns: float
    engine_ns: float
    binding_ns: float
    nstep: int
    costs: Sequence[Cost]


def measure(source: ModelSource, limit_s: float = 60.0, launches: int = LAUNCHES) -> Table:
    """Measure all sources on a model.

    Raises:
      InputError: the model cannot be loaded.
      MachineError: a launch crashed or hung.
    """
    from mjbench.loop import habits

    values: dict[str, list[float]] = {}
    request = {"name": source.name, "path": str(source.path)}
    for _ in range(launches):
        found: dict[str, float] = {}
        ended = isolate.run("mjbench.loop.overhead:launch", request, found.update, limit_s)
        if ended.status != "ok":
            raise (InputError if ended.status == "input" else MachineError)(ended.detail)
        for name, value in found.items():
            values.setdefault(name, []).append(value)
    bare = statistics.median(values.pop(habits.BARE.name))
    nstep = int(statistics.median(values.pop(_NSTEP)))
    known = {one.name: one for one in habits.HABITS}
    means = {name: statistics.mean(taken) for name, taken in values.items()}
    costs = [_cost(known[name], taken, bare, means) for name, taken in values.items()]
    costs = sorted((c for c in costs if c.source != BINDING), key=lambda c: -c.ns)
    return Table(source.name, bare, bare + means[ENGINE], means[BINDING], nstep, costs)


def launch(request: Mapping[str, Any], channel: Channel) -> None:
    """Time every source against the bare loop; runs in the child."""
    import gc

    from mjbench.loop import habits
    from mjbench.simulation import compat, models, work

    model = models.load(ModelSource(request["name"], Path(request["path"])))
    nstep = max(LEAST_NSTEP, int(BLOCK_S / work.step_s(model)))
    bare = habits.loop(habits.BARE, model, nstep).run
    runs = {
        one.name: habits.loop(one, model, nstep, request["path"]).run
        for one in habits.HABITS
        if one is not habits.BARE and habits.available(one, model, request["path"])
    }
    # the clock last: some releases do not get theirs back (compat.has_clock)
    names = sorted(random.sample(sorted(runs), len(runs)), key=lambda name: name == CLOCK)
    bares = []
    gc.disable()
    for name in names:
        channel.where(f"timing {name}")
        differences = []
        for run in (bare, runs[name]):
            run()
        for _ in range(QUADS):
            order = random.choice(("ABBA", "BAAB"))
            seconds = {"A": 0.0, "B": 0.0}
            for letter in order:
                run = bare if letter == "A" else runs[name]
                begin = time.perf_counter()
                run()
                seconds[letter] += time.perf_counter() - begin
            bares.append(5e8 * seconds["A"] / nstep)
            differences.append(5e8 * (seconds["B"] - seconds["A"]) / nstep)
        difference = statistics.median(differences)
        if name == CLOCK and not compat.has_clock(model):
            # the bare loop beside it had none either: those before had
            difference += statistics.median(bares[-QUADS:]) - statistics.median(bares[:-QUADS])
            del bares[-QUADS:]
        channel.send(**{name: difference})
    channel.send(**{habits.BARE.name: statistics.median(bares), _NSTEP: nstep})


def _cost(source: Any, taken: Sequence[float], bare: float, means: Mapping[str, float]) -> Cost:
    from scipy import stats

    from mjbench.loop import habits

    mean, half = statistics.mean(taken), float("inf")
    if len(taken) > 1:
        error = statistics.stdev(taken) / len(taken) ** 0.5
        half = float(stats.t.ppf((1 + CONFIDENCE) / 2, len(taken) - 1)) * error
    saved = mean - means[source.cheaper] if source.cheaper in means else None
    return Cost(
        source.name,
        mean,
        mean - half,
        mean + half,
        mean / bare,
        source.cheaper,
        saved,
        habits.code(source),
    )
