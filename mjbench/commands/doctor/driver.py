"""What `mjbench doctor` looks at and measures."""

from collections.abc import Iterator, Sequence

from mjbench.commands.doctor import detectable_change
from mjbench.commands.doctor.detectable_change import Noise
from mjbench.commands.profile import rendering
from mjbench.counts import instructions
from mjbench.errors import MjbenchError
from mjbench.host import conditions
from mjbench.host.conditions import Condition, Grade
from mjbench.host.neighbours import Neighbour
from mjbench.paired.worker_pool import WorkerPool
from mjbench.simulation import engine_clock, models

# Seconds that the conditions usually take.
CONDITIONS_S = 6.0
# Seconds after which a backend that renders nothing does not work.
_FRAME_LIMIT_S = 20.0


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


def compare_with_itself(budget_s: float) -> Noise:
    """Return how noisy a comparison of the cart-pole with itself is, or why there is none."""
    try:
        with WorkerPool() as pool:
            return detectable_change.noise(pool, budget_s)
    except MjbenchError as error:
        return Noise(detail=str(error))
