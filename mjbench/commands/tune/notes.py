"""The notes of a search for settings: what its figures rest on, and what it left out."""

from collections.abc import Iterator

from mjbench.commands.tune import expected_gains
from mjbench.commands.tune.accuracy import Distance
from mjbench.commands.tune.reference import REFINEMENT, CurrentSettings
from mjbench.commands.tune.result import TuneRecord
from mjbench.commands.tune.settings import label
from mjbench.formats import count_of, listed, plain, short_percent
from mjbench.results.starts import starts_lines
from mjbench.status import Status

# Settings that failed that are named.
_MOST_FAILED = 12


def notes(record: TuneRecord) -> list[str]:
    assert record.present is not None, "it was measured"
    lines = [*_basis(record.present), *starts_lines(record.present.starts)]
    lines += [
        f"Withdrawn by the second look: {label(each.settings)}: {each.reason}"
        for each in record.withdrawn
    ]
    failed = [row for row in record.attempts if row.status != Status.OK]
    lines += [f"Failed: {label(row.settings)}: {row.detail}" for row in failed[:_MOST_FAILED]]
    if len(failed) > _MOST_FAILED:
        lines.append(f"{len(failed) - _MOST_FAILED} more failed")
    lines += left_out(record)
    if (stage := expected_gains.untouched_stage(record)) is not None:
        lines.append(stage.text)
    if record.collision is not None:
        lines.append(f"Of a step, collisions of {record.collision}")
    return lines


def left_out(record: TuneRecord) -> Iterator[str]:
    """Yield what was not judged, and why, a line each."""
    if record.no_reference:
        left_out = (
            "from new starts, so errors are those of the search"
            if record.has_errors
            else "from which to measure errors, so settings that change the motion are not"
            " recommended"
        )
        yield f"There is no reference {left_out}: {record.no_reference}"
    if record.no_second_look:
        yield f"Not run again from new starts: {record.no_second_look}"
    counts = (record.untried, "setting"), (record.untried_combinations, "combination")
    if untried := [count_of(count, name) for count, name in counts if count]:
        yield f"There was no time for {listed(untried)}: give a longer --budget"


def _basis(present: CurrentSettings) -> Iterator[str]:
    if present.error is None or present.solver is None:
        yield (
            f"No reference was run, so errors are unknown: settings were compared with the present"
            f" ones over {plain(present.run_s, 3)} s of {present.nrun} simulations"
        )
        return
    yield (
        f"Error: distance from the model at 1/{REFINEMENT} of its timestep with a converged solver,"
        f" over {plain(present.horizon_s, 3)} s of {present.nrun} simulations; nine in"
        " ten stay below it. Change: distance from those with the present settings."
        f" Rounding alone: {percent(present.rounding.share)}. The solver alone:"
        f" {percent(present.solver.share)}."
    )
    if not present.is_comparable:
        yield (
            "These simulations part too soon to compare errors: no settings that change states by"
            " more than rounding are recommended"
        )


def in_units(error: Distance) -> str:
    """Return an error of positions in the units that they have."""
    position = error.position
    length = "" if position.m is None else _length(position.m)
    angle = "" if position.rad is None else f"{plain(position.rad, 2)} rad"
    return ", ".join(filter(None, [length, angle]))


def _length(metres: float) -> str:
    for unit, size in (("m", 1.0), ("mm", 1e-3), ("µm", 1e-6)):
        if metres >= size:
            return f"{plain(metres / size, 2)} {unit}"
    return f"{metres:.1g} m"


def percent(share: float) -> str:
    """Return a share in percent, in two digits, however small it is."""
    return f"{100 * share:.2g} %" if share < 1e-4 else short_percent(share)
