"""What Ray calls in its workers: what `node` does, without what Ray does to its workers."""

import contextlib
import os
from collections.abc import Iterator

import psutil

from mjbench.sweep import node
from mjbench.sweep.messages import Message, NodeAnswer, Request
from mjbench.sweep.model_files import CarriedModel

_THREADS = "OMP_NUM_THREADS"


def describe() -> NodeAnswer:
    """Return what this node is."""
    return node.describe()


def measure(request: Request, *carried: CarriedModel) -> Iterator[Message]:
    """Measure on this node; see `node.measure`."""
    parent = os.getppid()  # the node's own process, which a worker outlives while it is busy

    def is_lost() -> bool:
        return os.getppid() != parent

    # Ray sets it for its workers; the command is to have what whoever started Ray has set
    with contextlib.suppress(psutil.Error):
        if _THREADS not in psutil.Process(parent).environ():
            os.environ.pop(_THREADS, None)
    yield from node.measure(request, *carried, is_lost=is_lost)
    if is_lost():
        os._exit(1)
