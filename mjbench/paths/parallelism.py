"""Which options of a path mean parallelism."""

from collections.abc import Mapping
from typing import Any

PARALLEL_OPTIONS = ("threads", "processes", "engine_threads")


def nthread(options: Mapping[str, Any]) -> int:
    """Return how many threads or processes a path steps with; 1 where no option says."""
    return max(options.get(name) or 1 for name in PARALLEL_OPTIONS)
