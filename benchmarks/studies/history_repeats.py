"""How far the ratios of two measurements of the same releases differ.

    python -m benchmarks.studies.history_repeats FIRST.jsonl SECOND.jsonl

prints, for the steps of all models, by how much the second run file of `benchmarks.history measure`
differs from the first, and by how much the changes from one release to the next do.
"""

import itertools
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from benchmarks.history import files, known_causes
from benchmarks.history.speed_history import SpeedHistory
from benchmarks.studies import tally_command
from mjbench.status import ExitCode


def main(arguments: Sequence[str] | None = None) -> ExitCode:
    """Run the command; return its exit code."""
    parser = tally_command.parser(__doc__)
    parser.add_argument("first", type=Path, help="run file of `benchmarks.history measure`")
    parser.add_argument("second", type=Path, help="another one")
    options = parser.parse_args(arguments)
    first, second = (
        files.read([file], known_causes.FILE) for file in (options.first, options.second)
    )
    differences = repeated(first, second)
    changes = [b - a for series in differences for a, b in itertools.pairwise(series)]
    _print("ratios", np.concatenate([np.zeros(0), *differences]))
    _print("changes", np.array(changes))
    return ExitCode.OK


def repeated(first: SpeedHistory, second: SpeedHistory) -> list[np.ndarray]:
    """Return the differences of log ratios of the releases that both have, one array a model."""
    known = {
        (series.name, each.release): each.ratio.log_ratio
        for series in first.models
        for each in series.measured
    }
    return [
        np.array(
            [
                each.ratio.log_ratio - known[series.name, each.release]
                for each in series.measured
                if (series.name, each.release) in known
            ]
        )
        for series in second.models
    ]


def _print(name: str, differences: np.ndarray) -> None:
    if differences.size:
        deviation, largest = np.sqrt(np.mean(differences**2)), np.abs(differences).max()
        print(
            f"{differences.size} {name}: root mean square {100 * deviation:.1f} %,"
            f" largest difference {100 * largest:.1f} %"
        )


if __name__ == "__main__":
    raise SystemExit(main())
