"""How often verdicts are wrong, undecided or late, on launches whose truth is known.

    python -m benchmarks.studies.verdict_simulation [--comparisons 4000] [--only NAME …]

draws launches at random, judges them as `mjbench` does, prints how each scenario ends, and writes
results/verdicts.json and a part of docs/method/errors.md. It takes about three minutes. `--only`
simulates the scenarios whose name contains NAME, and writes nothing.
"""

import sys
from collections.abc import Sequence
from pathlib import Path

from benchmarks.studies import tally_command, tally_file, verdict_page, verdict_tally
from benchmarks.studies.verdict_tally import SCENARIOS, VerdictTally
from mjbench.status import ExitCode

ROOT = Path(__file__).resolve().parents[2]
TALLY: Path = ROOT / "results" / "verdicts.json"
COMPARISONS = 2000


def main(arguments: Sequence[str] | None = None) -> ExitCode:
    """Run the command; return its exit code."""
    parser = tally_command.parser(__doc__)
    parser.add_argument(
        "--comparisons",
        type=int,
        default=COMPARISONS,
        help="of each scenario, and number of families",
    )
    parser.add_argument("--only", action="append", metavar="NAME", help="part of a scenario's name")
    options = parser.parse_args(arguments)
    names = options.only or [""]
    selected = [s for s in SCENARIOS if any(name in s.name for name in names)]
    scenarios = []
    for row in verdict_tally.scenario_rows(selected, options.comparisons):
        print(verdict_page.scenario_line(row), flush=True)
        scenarios.append(row)
    if options.only:
        return ExitCode.OK
    families = []
    for family in verdict_tally.family_rows(options.comparisons):
        print(verdict_page.family_line(family), flush=True)
        families.append(family)
    tally = VerdictTally(options.comparisons, scenarios, families)
    tally_file.write(TALLY, tally)
    verdict_page.PART.write(verdict_page.lines(tally))
    return ExitCode.OK


if __name__ == "__main__":
    sys.exit(main())
