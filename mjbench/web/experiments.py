"""Experiments with a WebAssembly build, whatever the model: its memory, its sines and cosines."""

import contextlib
import math
import random
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from mjbench.instrument import scratch
from mjbench.paired.ending import ENDING_ERRORS, ending_of
from mjbench.simulation import models
from mjbench.web import messages
from mjbench.web.build_run import Engine
from mjbench.web.node_process import NodeError, NodeProcess
from mjbench.web.npm_package import Build
from mjbench.web.records import Mathematics, WebExperimentsRecord

# Angles whose sines and cosines are compared, in rad up to this.
_COUNT, _LARGEST = 2000, math.pi


def examine(engine: Engine, build: Build) -> WebExperimentsRecord:
    """Return what experiments with a build show, in Node processes of their own."""
    record = WebExperimentsRecord(
        build=build, release=engine.package.version, node=engine.node.version
    )
    try:
        with scratch.folder() as folder:
            with _instantiated(engine, build, folder / "memory") as process:
                rng = random.Random(0)
                angles = [rng.uniform(-_LARGEST, _LARGEST) for _ in range(_COUNT)]
                rotated = process.call(messages.Rotate(angles))
                record = replace(record, mathematics=mathematics(angles, rotated))
                cartpole = models.resolve("cartpole").path
                examined = process.call(messages.Examine(str(cartpole)))
                record = replace(record, examined=examined)
            with _instantiated(engine, build, folder / "limit") as process:
                filled = process.call(messages.FillHeap())
                return replace(record, limits=filled.limits)
    except ENDING_ERRORS as error:
        failure = error.failure if isinstance(error, NodeError) else ending_of(error)
        return replace(record, status=failure.status, detail=failure.detail)


@contextlib.contextmanager
def _instantiated(engine: Engine, build: Build, folder: Path) -> Iterator[NodeProcess]:
    """Yield a process with a fresh build, and end it."""
    process = engine.start(build, "experiments", folder)
    try:
        engine.instantiate(process, build)
        yield process
    finally:
        process.end()


def mathematics(angles: Sequence[float], rotated: messages.Rotated) -> Mathematics:
    """Return how often sines and cosines differ from those of this system's C library.

    The engine computes the cosine and the sine of half of an angle for its quaternion, the first
    and the last entry (`mju_axisAngle2Quat`).

    Args:
      angles: in rad.
      rotated: rotations by them.
    """
    sines = cosines = 0
    largest = 0.0
    for angle, (cosine, _, _, sine) in zip(angles, rotated.quaternions, strict=True):
        in_c = math.cos(0.5 * angle), math.sin(0.5 * angle)
        cosines += cosine != in_c[0]
        sines += sine != in_c[1]
        largest = max(largest, abs(cosine - in_c[0]), abs(sine - in_c[1]))
    return Mathematics(len(angles), sines, cosines, largest)
