"""Tables of what there is: models, paths and releases."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from mjbench.comparison.listing import ListedModel
from mjbench.paths import SteppingPath
from mjbench.releases.catalogue import ReleaseRow
from mjbench.report.content import Column, DataTable
from mjbench.report.formats import yes_no


@dataclass(frozen=True)
class PathRow:
    """A way of stepping.

    Attributes:
      summary: what it is, in a few words.
      closed_loop: whether a policy can choose each control from the state before it.
      unavailable: why it cannot run here; None if it can.
      options: what each option does, by name.
    """

    path: str
    summary: str
    closed_loop: bool
    unavailable: str | None
    options: Mapping[str, str]

    @classmethod
    def of(cls, path: SteppingPath) -> "PathRow":
        """Return the row of a path."""
        return cls(
            path=path.name,
            summary=path.summary,
            closed_loop=path.closed_loop,
            unavailable=path.unavailable(),
            options={option.name: option.summary for option in path.options},
        )


def models_table(rows: Sequence[ListedModel]) -> DataTable:
    """Return the table of `mjbench models`, of those that could be loaded."""
    sizes = ("nq", "nv", "nu", "na", "contacts", "constraints")
    columns = [
        Column("model"),
        *(Column(size, str) for size in sizes),
        Column("timestep", lambda timestep: f"{1e3 * timestep:g} ms"),
        Column("integrator"),
        Column("solver"),
    ]
    cells = [
        (
            row.model,
            *(getattr(row.facts, size) for size in sizes),
            row.facts.timestep,
            row.facts.integrator,
            row.facts.solver,
        )
        for row in rows
        if row.facts is not None
    ]
    return DataTable("Models", columns, cells)


def failed_models(rows: Sequence[ListedModel]) -> list[str]:
    """Return why models could not be loaded, a line each."""
    return [
        f"{row.model}: {row.detail.removeprefix(f'{row.model}: ')}"
        for row in rows
        if row.facts is None
    ]


def paths_table(rows: Sequence[PathRow]) -> DataTable:
    """Return the table of `mjbench paths`."""
    titles = ("path", "closed loop", "here", "what it is", "options")
    cells = [
        (
            row.path,
            yes_no(row.closed_loop),
            row.unavailable or "yes",
            row.summary,
            ", ".join(row.options),
        )
        for row in rows
    ]
    return DataTable("Paths", [*map(Column, titles)], cells)


def releases_table(rows: Sequence[ReleaseRow]) -> DataTable:
    """Return the table of `mjbench releases`: where each one is."""
    titles = ("release", "uploaded (UTC)", "on the index", "in the history", "here")
    cells = [
        (
            row.version,
            (row.uploaded or "unknown")[:10],
            "not asked" if row.in_index is None else yes_no(row.in_index),
            yes_no(row.in_history),
            "installed" if row.installed else "",
        )
        for row in rows
    ]
    return DataTable("Releases", [*map(Column, titles)], cells)
