"""The options of `mjbench sweep`."""

from dataclasses import dataclass
from pathlib import Path

from mjbench.commands.shared_options import FormOptions, results_option
from mjbench.options import FLAG, option, text


@dataclass(frozen=True, kw_only=True)
class SweepOptions(FormOptions):
    """Where a sweep measures, and where its run files go."""

    address: str | None = option(
        None,
        text("HOST:PORT|auto"),
        "Ray cluster to measure on; `auto` is the one that this machine belongs to",
        unset="this machine alone",
    )
    results: Path | None = results_option(None, "results/sweeps/PLAN")
    dry_run: bool = option(False, FLAG, "Print what would be measured; measure nothing.")
