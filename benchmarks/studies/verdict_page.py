"""The page docs/method/verdict-errors.md, written from the tally of simulated comparisons.

`python -m benchmarks.studies.verdict_page` writes it again from results/verdicts.json.
"""

from collections.abc import Iterator, Sequence

from benchmarks.studies.verdict_tally import FAMILY, FamilyRow, ScenarioRow, VerdictTally


def page(tally: VerdictTally) -> str:
    """Return the Markdown page of a tally."""
    return "\n".join(_lines(tally)) + "\n"


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


def _lines(tally: VerdictTally) -> Iterator[str]:
    yield "# How often a verdict is wrong, simulated"
    yield ""
    yield "Written by `make verdicts` from `results/verdicts.json`; do not edit."
    yield ""
    yield _conclusion(tally.scenarios)
    yield ""
    yield from _POWER
    yield ""
    yield from _power_table(tally.scenarios)
    yield from _TERMS
    yield ""
    yield f"## All scenarios, {tally.comparisons:,} comparisons for each line"
    yield ""
    yield (
        "| launches | true change | slower, % | faster, % | same, % | inconclusive, % |"
        " mean launches | bias, % | covered, % |"
    )
    yield "|---|---:|" + "---:|" * 7
    yield from map(scenario_line, tally.scenarios)
    yield ""
    yield from _FAMILIES
    yield ""
    yield (
        "| launches | rule | true change of one | gate fails, % | wrongly, % |"
        " launches, unchanged | launches, changed |"
    )
    yield "|---|---|---:|" + "---:|" * 4
    yield from map(family_line, tally.families)
    yield from _HOW


def _conclusion(rows: Sequence[ScenarioRow]) -> str:
    unchanged = [row for row in rows if row.change == 0]
    held = [row for row in unchanged if _wrong(row) <= 0.01]
    beyond = [row for row in unchanged if row not in held]
    text = (
        "Targets that do not differ are called slower or faster in at most"
        f" {100 * max(map(_wrong, held)):.1f} % of comparisons, in {len(held)} of"
        f" {len(unchanged)} scenarios."
    )
    if beyond:
        listing = "; ".join(f"{row.scenario}: {100 * _wrong(row):.1f} %" for row in beyond)
        text += f" The level of 1 % is not kept in {len(beyond)}: {listing}."
    return text


def _wrong(row: ScenarioRow) -> float:
    return row.slower + row.faster


_POWER = """\
## How often a true change is found

Share of comparisons called `slower`, in percent. With `--fail-on slower`, these end with exit
code 1.""".splitlines()


def _power_table(rows: Sequence[ScenarioRow]) -> Iterator[str]:
    changes = sorted({row.change for row in rows})
    yield f"| launches | {' | '.join(f'{100 * change:g} %' for change in changes)} |"
    yield "|---|" + "---:|" * len(changes)
    for name in dict.fromkeys(row.scenario for row in rows):
        shares = {row.change: row.slower for row in rows if row.scenario == name}
        yield f"| {name} | {' | '.join(f'{100 * shares[c]:.1f}' for c in changes)} |"


_TERMS = """
## What the scenarios are

- The percentage is the deviation of launches, 0.85 % where none is given. Limits are the defaults:
  smallest effect 1 %, confidence 99 %, precision 0.5 %. The time limit ends a comparison after 80
  launches.
- *Two modes*: a launch is off by 0.8 % to one side or the other, and by little else.
- *Skewed*: launches are exponentially distributed, and the truth is their mean. The longest ones
  look disturbed and are left out, which is the bias. Targets that do not differ cannot cause this:
  where times of both are skewed alike (*skewed alike*), log ratios are symmetric.
- *Disturbed* launches are off by ten deviations, to either side.
- *Correlated*: each launch with the one before. The 21,129 launches of the committed
  [selfchecks](selfcheck.md) have a correlation of 0.008, with a standard error of 0.007. An
  interval that is widened by the correlation estimated from its own launches was tried and not
  adopted. It took 11 % more launches (placed: 25 %) where there is no correlation, and was wrong in
  2.1 % (placed: 1.2 %) of comparisons where it is 0.5.
- *Of one program*: every eight launches in a row are correlated, because their processes were
  [forked from the same programs](paired.md#launches). *In pairs*: every two are, as where the
  kernel draws the addresses of programs.
- *Placed*: each launch moves both libraries to one of four residues modulo 64. Between these, the
  baseline's time differs by up to 6.4 % (measured: pile, MuJoCo 3.2.1), the candidate's as much, in
  another order.
- *Within a page 0.7 %*: what the place of code within its page does to each side (standard
  deviation); every launch draws another place.
- *All kinds of noise*: the sum of normal, two-modal and skewed noise, 10 % disturbed, and places
  within a page that differ by 0.7 %.
- *Bias* is the mean of the estimate minus the truth. It is positive where launches stop because the
  change looks large. *Covered* is how often the last interval contains the truth.""".splitlines()

_FAMILIES = f"""\
## Families of comparisons

The more models one compares, the more likely is one false alarm among them. Here one of {FAMILY}
models is slower, or none is. The gate fails if one or more are found slower, and *wrongly* if one
of those is not slower.

- *Each verdict alone*: no allowance for the number of models.
- *E-values of the family*: where a candidate is not slower, its e-value ever reaches 1 / p with a
  probability of at most p. The procedure of Benjamini and Hochberg decides from all e-values: a
  single slower model needs {100 * FAMILY:,}, the number of models over 1 %; two need half of that
  each. A comparison that looks slower or faster goes on until its e-value suffices alone, and most
  have reached it when their interval is narrow enough. (Wang and Ramdas, False discovery rate
  control with e-values, Journal of the Royal Statistical Society B 84, 2022.)
- *Confidence of 99.9 %*: each verdict at a tenth of the error rate, which also delays models that
  did not change.""".splitlines()

_HOW = """
## Run it again

`make verdicts` takes about three minutes. To print the lines of some scenarios:
`python -m benchmarks.studies.verdict_simulation --only NAME`.""".splitlines()


if __name__ == "__main__":
    from benchmarks.studies import verdict_simulation, verdict_tally

    tally = verdict_tally.load(verdict_simulation.TALLY)
    verdict_simulation.PAGE.write_text(page(tally), encoding="utf-8")
