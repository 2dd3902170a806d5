"""What docs/method/errors.md has of the tally of simulated comparisons.

`python -m benchmarks.studies.verdict_page` writes it again from results/verdicts.json.
"""

from collections.abc import Iterator, Sequence

from benchmarks.studies.page_part import PagePart
from benchmarks.studies.verdict_tally import FAMILY, TOGETHER, FamilyRow, ScenarioRow, VerdictTally
from mjbench import formats
from mjbench.paired.outcomes import CONFIDENCE

# Scenarios in which launches are limited.
_LIMITED = "at most"
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
    """Yield the conclusion, then how often changes are found."""
    yield f"{_conclusion(tally.scenarios)} {_family_conclusion(tally.families)}"
    yield ""
    yield _power(tally)


def _power(tally: VerdictTally) -> str:
    """Return how often each change is called slower, and how often intervals hold."""
    rows = [row for row in tally.scenarios if row.change]
    unlimited = [row for row in rows if not row.scenario.startswith(_LIMITED)]
    changes = sorted({row.change for row in rows})
    least = [min(row.slower for row in unlimited if row.change == change) for change in changes]
    found = formats.listed(
        [f"one of {100 * c:g} % in {100 * n:.1f} %" for c, n in zip(changes, least, strict=True)]
    )
    few = max(row.slower for row in rows if row.scenario.startswith(f"{_LIMITED} 8"))
    worst = min(tally.scenarios, key=lambda row: row.covered)
    return (
        "A slowdown is called `slower` in at least this share of"
        f" {tally.comparisons:,} comparisons: {found}. That is without a limit of launches. With"
        f" eight launches, at most {100 * few:.0f} % are. {100 * CONFIDENCE:g} % of the intervals"
        f" should contain the truth. In the worst scenario ({worst.scenario}),"
        f" {100 * worst.covered:.1f} % do."
    )


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
