"""Which options of a path mean parallelism, and how many threads an option set steps with."""

from collections.abc import Mapping
from typing import Any

# Options that set how many threads or worker processes share the simulations, as --threads does.
WORKER_OPTIONS = ("threads", "processes", "actors")
# All options that set a number of threads or worker processes.
PARALLEL_OPTIONS = (*WORKER_OPTIONS, "engine_threads")


def nthread(options: Mapping[str, Any]) -> int:
    """Return the threads or worker processes that an option set steps with; 1 if it names none."""
    return max(options.get(name) or 1 for name in PARALLEL_OPTIONS)
