"""What `mjbench doctor` looks at and measures, and what it does by --verdicts."""

import contextlib
from collections.abc import Iterator, Sequence
from dataclasses import asdict

from mjbench.api.session import (
    Item,
    Items,
    Measurement,
    Observer,
    input_files,
    pinning_notes,
)
from mjbench.counts import instructions
from mjbench.errors import Failure, MjbenchError
from mjbench.host import conditions
from mjbench.host.conditions import Condition, Grade
from mjbench.host.neighbours import Neighbour
from mjbench.loop import rendering
from mjbench.paired import detectable_change, selfcheck
from mjbench.paired.selfcheck_records import trial_records
from mjbench.paired.verdict import VerdictPlan
from mjbench.paired.worker_pool import WorkerPool
from mjbench.report.doctor import NoiseRow
from mjbench.report.selfcheck import describe_case
from mjbench.simulation import engine_clock, models
from mjbench.store.runs import Record

# Seconds after which a backend that renders nothing does not work.
_FRAME_LIMIT_S = 20.0
# The arm of known slowdowns, unless other arms are asked for.
_SLOWDOWNS = (0.0, 0.005, 0.01, 0.02, 0.05)


def all_conditions(others: Sequence[Neighbour]) -> list[Condition]:
    """Return what the machine, MuJoCo, valgrind and rendering are like here."""
    return [*conditions.all_conditions(others), *_timer(), _valgrind(), _rendering()]


def _timer() -> Iterator[Condition]:
    share = detectable_change.clock_share()
    if share is not None:
        detail = f"takes {100 * share:.0f} % of a cart-pole's step"
        yield Condition("MuJoCo's timer", Grade.NOTE, detail, engine_clock.OFF_NOTE)


def _valgrind() -> Condition:
    if missing := instructions.unavailable():
        return Condition("valgrind", Grade.NOTE, "is missing", missing)
    return Condition("valgrind", Grade.GOOD, "is there: instructions can be counted")


def _rendering() -> Condition:
    source = models.resolve(detectable_change.MODEL)
    frames = [rendering.measure(source, name, _FRAME_LIMIT_S) for name in rendering.BACKENDS]
    speeds = [f"{f.backend} {1e3 * f.seconds:.1f} ms a frame" for f in frames if f.seconds]
    if speeds:
        return Condition("rendering", Grade.GOOD, f"works: {', '.join(speeds)}")
    reasons = "; ".join(f"{frame.backend}: {frame.detail}" for frame in frames)
    return Condition("rendering", Grade.NOTE, "does not work", reasons)


def compare_with_itself(budget_s: float) -> NoiseRow:
    """Return how noisy a comparison of the cart-pole with itself is, or why there is none."""
    try:
        with WorkerPool() as pool:
            return NoiseRow.of(detectable_change.noise(pool, budget_s))
    except MjbenchError as error:
        return NoiseRow(detail=str(error))


def trials(
    names: Sequence[str],
    count: int,
    slowdowns: Sequence[float] | None,
    functions: Sequence[str],
    between_builds: bool,
    is_busy: bool,
    plan: VerdictPlan,
) -> Measurement:
    """Return the measurement of `count` verdicts on each pair of targets that differ as is known.

    Args:
      slowdowns: by how much longer blocks of a candidate last, as shares; None for the usual ones,
        or for none where functions or builds are compared.
      functions: of the engine; another candidate each calls one of them once more in each step.
      between_builds: whether releases of equally many instructions are compared, too.
      is_busy: whether the last core is kept busy meanwhile.
    """
    if slowdowns is None:
        slowdowns = [] if functions or between_builds else _SLOWDOWNS
    functions = list(dict.fromkeys(functions))
    cases = selfcheck.cases(names, slowdowns, functions, between_builds)
    sources = list(dict.fromkeys(case.candidate.model for case in cases))

    def items(earlier: Sequence[Record], observer: Observer) -> Items:
        done = trial_records(earlier)
        remaining = selfcheck.remaining(cases, count, done)
        with (
            selfcheck.busy_neighbour_core() if is_busy else contextlib.nullcontext(),
            WorkerPool() as pool,
        ):
            for number, (case, ended) in enumerate(selfcheck.run(pool, remaining, plan), len(done)):
                name = f"{case.model}, {describe_case(case)}"
                if isinstance(ended, Failure):
                    yield Item(failure=Failure(ended.status, f"{name}: {ended.detail}"))
                    continue
                observer(name, (number + 1) / (count * len(cases)))
                yield Item([ended])

    return Measurement(
        "selfcheck",
        {
            **asdict(plan),
            "trials": count,
            "busy": is_busy,
            "slowdowns": list(slowdowns),
            "models": [source.name for source in sources],
            "inside_step": functions,
            "between_builds": between_builds,
        },
        input_files(sources, [], plan.sizes.starts),
        items,
        trial_records,
        pinning_notes(),
    )
