"""What a step costs, by model: measured once, then the same in every run.

Sizes of blocks follow from these costs and not from a measurement of their own, so two identical
commands do identical work. A cost is rounded to a power of two, and a model has the same one in
every release. The costs of the shipped models come with the package; those of others are kept in a
file of the user's. Nothing depends on that file: where it cannot be read or written, costs are
measured again. `benchmarks/studies/shipped_step_costs.py` measures those of the shipped models.
"""

import contextlib
import json
import math
import os
from collections.abc import Callable, Mapping
from pathlib import Path

from mjbench.errors import MachineError, MjbenchError
from mjbench.host import files
from mjbench.releases import installs

# Names another file than the one in the cache folder.
FILE_VARIABLE = "MJBENCH_STEP_COSTS"
# The table of the shipped models.
SHIPPED = Path(__file__).with_name("step_costs.json")
_FILE_NAME = "step-costs.json"
# Costs that a step can have, in seconds; others are those of a damaged file.
_LEAST_S, _MOST_S = 1e-9, 1e6


def step_cost_s(digest: str, measure: Callable[[], float]) -> float:
    """Return about how many seconds a step takes, a power of two; measured if in no table."""
    for table in (_read(SHIPPED), _read(_user_file())):
        if digest in table:
            return rounded_s(table[digest])
    return rounded_s(_remember(digest, max(_LEAST_S, measure())))


def rounded_s(seconds: float) -> float:
    return 2.0 ** round(math.log2(seconds))


def as_text(table: Mapping[str, float]) -> str:
    return json.dumps(table, indent=1, sort_keys=True) + "\n"


def _user_file() -> Path | None:
    named = os.environ.get(FILE_VARIABLE)
    if named:
        return Path(named)
    try:
        return installs.cache_folder() / _FILE_NAME
    except MjbenchError:
        return None


def _read(file: Path | None) -> dict[str, float]:
    """Return a table; an empty one where it cannot be read."""
    if file is None:
        return {}
    try:
        table = json.loads(file.read_text())
    except (OSError, ValueError, RecursionError):
        return {}
    return {
        digest: float(seconds)
        for digest, seconds in (table.items() if isinstance(table, dict) else ())
        if isinstance(seconds, int | float) and _LEAST_S <= seconds <= _MOST_S
    }


def _remember(digest: str, seconds: float) -> float:
    """Add a cost to the user's table; return the cost that it holds then: the first one counts."""
    file = _user_file()
    if file is None:
        return seconds
    with contextlib.suppress(OSError, MachineError), installs.locked(_FILE_NAME):
        table = _read(file)
        if digest in table:
            return table[digest]
        table[digest] = seconds
        with files.replacing(file) as partial:
            partial.write_text(as_text(table))
    return seconds
