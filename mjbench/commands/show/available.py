"""Lists of what there is, and their documents: models, paths, releases and installs."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from mjbench.formats import count_of, mebibytes, yes_no
from mjbench.releases.catalogue import ReleaseRow
from mjbench.releases.installs import InstallSize
from mjbench.results.content import Column, DataTable
from mjbench.results.runs import SCHEMA

if TYPE_CHECKING:  # both import MuJoCo
    from mjbench.commands.show.model_facts import ListedModel
    from mjbench.paths import SteppingPath


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
    def of(cls, path: "SteppingPath") -> "PathRow":
        return cls(
            path=path.name,
            summary=path.summary,
            closed_loop=path.closed_loop,
            unavailable=path.unavailable(),
            options={option.name: option.summary for option in path.options},
        )


@dataclass(frozen=True, kw_only=True)
class InstallsDocument:
    """What `mjbench releases installs --json` writes."""

    schema: int = SCHEMA
    folder: str
    installs: Sequence[InstallSize]


def models_table(rows: "Sequence[ListedModel]") -> DataTable:
    sizes = {"nq": 4, "nv": 0, "nu": 0, "na": 3, "contacts": 0, "constraints": 0}
    return DataTable.of(
        "Models",
        [(row.model, row.facts) for row in rows if row.facts is not None],
        (Column("model"), lambda row: row[0]),
        *(
            (Column(size, str, leaves=leaves), lambda row, size=size: getattr(row[1], size))
            for size, leaves in sizes.items()
        ),
        (Column("timestep", lambda seconds: f"{1e3 * seconds:g} ms"), lambda row: row[1].timestep),
        (Column("integrator", leaves=2), lambda row: row[1].integrator),
        (Column("solver", leaves=1), lambda row: row[1].solver),
    )


def failed_models(rows: "Sequence[ListedModel]") -> list[str]:
    return [
        f"{row.model}: {row.detail.removeprefix(f'{row.model}: ')}"
        for row in rows
        if row.facts is None
    ]


def paths_table(rows: Sequence[PathRow]) -> DataTable:
    return DataTable.of(
        "Paths",
        rows,
        (Column("path"), lambda row: row.path),
        (Column("closed loop"), lambda row: yes_no(row.closed_loop)),
        (Column("here"), lambda row: row.unavailable or "yes"),
        (Column("what it is"), lambda row: row.summary),
        (Column("options", leaves=1), lambda row: ", ".join(row.options)),
    )


def releases_table(rows: Sequence[ReleaseRow]) -> DataTable:
    """Return the table of `mjbench releases`: where each one is."""
    return DataTable.of(
        "Releases",
        rows,
        (Column("release"), lambda row: row.version),
        (Column("uploaded (UTC)"), lambda row: (row.uploaded or "unknown")[:10]),
        (
            Column("on the index"),
            lambda row: "not asked" if row.in_index is None else yes_no(row.in_index),
        ),
        (Column("here"), lambda row: "installed" if row.installed else "cached" * row.in_cache),
    )


def install_lines(installs: Sequence[InstallSize]) -> Iterator[str]:
    """Yield installs, a line each, and the size of several together."""
    for install in installs:
        days = int(install.unused_days)
        used = "today" if days < 1 else f"{count_of(days, 'day')} ago"
        yield f"{install.name}  {mebibytes(install.size_bytes)}, used {used}"
    if len(installs) > 1:
        total_bytes = sum(install.size_bytes for install in installs)
        yield f"{len(installs)} installs, {mebibytes(total_bytes)}"
