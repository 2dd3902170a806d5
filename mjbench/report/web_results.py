"""Speeds of WebAssembly builds and of C, and their times relative to C's."""

import statistics
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from mjbench.instrument import stats
from mjbench.instrument.stats import Estimate
from mjbench.simulation.starts import Starts
from mjbench.simulation.work import Work
from mjbench.status import Status
from mjbench.web.records import C_PATH, StartUp, WebPathRecord, WebRecord
from mjbench.web.rounding_check import RoundingCheck


@dataclass(frozen=True)
class WebPathRow:
    """One path on one model.

    Attributes:
      status: `ok`, or why it has no speed.
      check: how far it is from C; None for paths of C, and where it did not run.
      step_ns: of a step, the median block; None without a speed.
      steps_per_s: steps per second; None likewise.
      ratio: its time over that of `rollout` on one thread, round by round; None likewise.
      rounds: blocks that were timed.
      start_up: what it took before it was steady; None for paths of C, and without a speed.
      heap_bytes: of its module; None likewise.
      rss_bytes: resident memory of its process; None where it is not known.
    """

    path: str
    options: Mapping[str, Any]
    status: Status
    detail: str
    check: RoundingCheck | None
    step_ns: float | None
    steps_per_s: float | None
    ratio: Estimate | None
    rounds: int
    start_up: StartUp | None
    heap_bytes: int | None
    rss_bytes: int | None

    @property
    def is_wasm(self) -> bool:
        """Whether it is a WebAssembly build, rather than C."""
        return self.path.startswith("wasm")


@dataclass(frozen=True, kw_only=True)
class WebRow:
    """A model, in C and in the WebAssembly builds of the same release (see `WebRecord`)."""

    model: str
    release: str
    node: str
    status: Status
    detail: str
    nbatch: int | None
    nstep: int | None
    block_nbatch: int | None
    block_nstep: int | None
    hold: int
    seed: int
    workload_digest: str
    starts: Starts | None
    work: Work | None
    c_compile_ms: float | None
    paths: Sequence[WebPathRow]

    def statuses(self) -> Iterator[Status]:
        """Yield how the measurement ended, and how each path did."""
        yield self.status
        yield from (path.status for path in self.paths)


@dataclass(frozen=True)
class WebTableRow:
    """A path on a model, as a row of a flat table."""

    model: str
    release: str
    path: str
    options: Mapping[str, Any]
    status: Status
    detail: str
    is_identical: bool | None
    difference: float | None
    step_ns: float | None
    steps_per_s: float | None
    ratio: Estimate | None
    heap_bytes: int | None
    rss_bytes: int | None


def rows(record: WebRecord) -> list[WebTableRow]:
    """Return the paths on a model, a row each."""
    row = derive(record)
    return [
        WebTableRow(
            row.model,
            row.release,
            path.path,
            path.options,
            path.status,
            path.detail,
            None if path.check is None else path.check.first is None,
            None if path.check is None else path.check.final.difference,
            path.step_ns,
            path.steps_per_s,
            path.ratio,
            path.heap_bytes,
            path.rss_bytes,
        )
        for path in row.paths
    ]


def derive(record: WebRecord) -> WebRow:
    """Return what follows from the samples of a model."""
    base = next((path.block_ns for path in record.paths if path.path == C_PATH), ())
    return WebRow(
        model=record.model,
        release=record.release,
        node=record.node,
        status=record.status,
        detail=record.detail,
        nbatch=record.nbatch,
        nstep=record.nstep,
        block_nbatch=record.block_nbatch,
        block_nstep=record.block_nstep,
        hold=record.hold,
        seed=record.seed,
        workload_digest=record.workload_digest,
        starts=record.starts,
        work=record.work,
        c_compile_ms=record.c_compile_ms,
        paths=[
            _path_row(path, base, (record.block_nbatch or 1) * (record.block_nstep or 1))
            for path in record.paths
        ],
    )


def _path_row(path: WebPathRecord, base_ns: Sequence[int], steps: int) -> WebPathRow:
    """Return the row of a path.

    Args:
      path: its record.
      base_ns: blocks of C in the same rounds; none where it was not timed.
    """
    step_ns = statistics.median(path.block_ns) / steps if path.block_ns else None
    return WebPathRow(
        path=path.path,
        options=path.options,
        status=path.status,
        detail=path.detail,
        check=path.check,
        step_ns=step_ns,
        steps_per_s=1e9 / step_ns if step_ns else None,
        ratio=stats.speedup_in_common(path.block_ns, base_ns) if step_ns and base_ns else None,
        rounds=len(path.block_ns),
        start_up=path.start_up,
        heap_bytes=path.heap_bytes,
        rss_bytes=path.rss_bytes,
    )
