"""Made-up records of `mjbench web`."""

from typing import Any

from mjbench.simulation.reference_run import Work
from mjbench.web.records import StartUp, WebPathRecord, WebRecord
from mjbench.web.rounding_check import FirstDifference, PointDifference, RoundingCheck, StepErrors

FIRST = FirstDifference(7, "qpos", 1, 3, 2.2e-16)
CHECK = RoundingCheck(
    nstep=100,
    first=FIRST,
    points=[PointDifference(0, 0.0, 0.0), PointDifference(100, 3e-14, 5e-14)],
    excess=None,
    unconstrained_nstep=100,
    unconstrained=StepErrors(12, 1e-16, 2e-16, 0.0, 1e-16),
    constrained=StepErrors(0, 0.0, 0.0, 0.0, 0.0),
    first_of_same_model=FIRST,
    has_same_model=True,
)
START_UP = StartUp(10.0, 200.0, 50.0, 9000.0, 0.1, 1 << 24)


def path(name: str, block_ns: int, **fields: Any) -> WebPathRecord:
    return WebPathRecord(path=name, options={}, block_ns=[block_ns] * 8, **fields)


def record(*builds: WebPathRecord) -> WebRecord:
    of_c = [path("python_loop", 3_000_000), path("rollout", 2_000_000)]
    return WebRecord(
        model="cartpole",
        release="3.14.0",
        node="20.1.2",
        nbatch=4,
        nstep=100,
        block_nbatch=2,
        block_nstep=100,
        work=Work(0.0, 0.0, 0.0),
        paths=[*of_c, *builds],
    )


def wasm(check: RoundingCheck = CHECK, name: str = "wasm") -> WebPathRecord:
    return path(name, 5_000_000, check=check, start_up=START_UP, heap_bytes=1 << 24, rss_bytes=1)
