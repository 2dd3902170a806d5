"""What docs/method/errors.md has of the tally of simulated comparisons.

`python -m benchmarks.studies.verdict_page` writes it again from results/verdicts.json.
"""

from collections.abc import Iterator, Sequence

from benchmarks.studies.page_part import PagePart
from benchmarks.studies.verdict_tally import FAMILY, TOGETHER, FamilyRow, ScenarioRow, VerdictTally
from mjbench.results import markdown

_PLACED = ", placed"
PART = PagePart("method/errors.md", "verdicts", "benchmarks.studies.verdict_page")


def scenario_line(row: ScenarioRow) -> str:
    """Return the row of the table of scenarios."""
    cells = (
        row.scenario,
        f"{100 * row.change:g} %",
        *(f"{100 * share:.1f}" for share in (row.slower, row.faster, row.same, row.inconclusive)),
        f"{row.launches:.1f}",
        f"{100 * row.bias:+.2f}",
        f"{100 * row.covered:.1f}",
    )
    return f"| {' | '.join(cells)} |"


def family_line(row: FamilyRow) -> str:
    """Return the row of the table of families."""
    cells = (
        row.scenario,
        row.rule,
        f"{100 * row.change:g} %",
        f"{100 * row.failed:.1f}",
        f"{100 * row.wrong:.1f}",
        f"{row.launches:.1f}",
        f"{row.launches_changed:.1f}",
    )
    return f"| {' | '.join(cells)} |"


def lines(tally: VerdictTally) -> Iterator[str]:
    """Yield the conclusion, then a row for each scenario."""
    yield f"{_conclusion(tally.scenarios)} {_family_conclusion(tally.families)}"
    yield ""
    yield (
        f"Shares of {tally.comparisons:,} comparisons, in percent: called `slower` or `faster`"
        " although nothing changed; called `slower` at each true change; and intervals that"
        " contain the truth."
    )
    yield ""
    changes = sorted({row.change for row in tally.scenarios} - {0.0})
    columns = ["wrong at 0 %", *(f"found at {100 * c:g} %" for c in changes), "contain"]
    scenarios = dict.fromkeys(row.scenario for row in tally.scenarios)
    # placement hardly changes a scenario that is there without it, too
    names = [
        n
        for n in scenarios
        if n.removesuffix(_PLACED) == n or n.removesuffix(_PLACED) not in scenarios
    ]
    rows = (_cells(name, [r for r in tally.scenarios if r.scenario == name]) for name in names)
    yield from markdown.table_lines(["launches", *columns], rows, columns)


def _cells(name: str, rows: Sequence[ScenarioRow]) -> list[str]:
    unchanged, *changed = sorted(rows, key=lambda row: row.change)
    least = min(row.covered for row in rows)
    shares = [_wrong(unchanged), *(row.slower for row in changed), least]
    return [name, *(f"{100 * share:.1f}" for share in shares)]


def _conclusion(rows: Sequence[ScenarioRow]) -> str:
    unchanged = [row for row in rows if row.change == 0]
    held = [row for row in unchanged if _wrong(row) <= 0.01]
    beyond = [row for row in unchanged if row not in held]
    text = (
        f"In {len(held)} of {len(unchanged)} scenarios, at most"
        f" {100 * max(map(_wrong, held)):.1f} % of equal targets are called slower or faster."
    )
    if beyond:
        listing = "; ".join(f"{row.scenario}: {100 * _wrong(row):.1f} %" for row in beyond)
        text += f" In {len(beyond)} scenarios it is more than 1 %: {listing}."
    return text


def _family_conclusion(rows: Sequence[FamilyRow]) -> str:
    worst = max(row.wrong for row in rows if row.rule == TOGETHER)
    return (
        f"Of {FAMILY} models decided together, an unchanged one is named slower in at most"
        f" {100 * worst:.1f} % of comparisons."
    )


def _wrong(row: ScenarioRow) -> float:
    return row.slower + row.faster


if __name__ == "__main__":
    from benchmarks.studies import verdict_simulation, verdict_tally

    PART.write(lines(verdict_tally.load(verdict_simulation.TALLY)))
