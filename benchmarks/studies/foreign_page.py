"""What docs/results.md has of the tally of `benchmarks.studies.foreign`.

`python -m benchmarks.studies.foreign_page` writes it again from results/foreign.json.
"""

import re
from collections.abc import Iterator

from benchmarks.studies.foreign_tally import NO_MODEL, ForeignTally, Outcome
from benchmarks.studies.page_part import PagePart
from mjbench.results import markdown

PART = PagePart("results.md", "foreign", "benchmarks.studies.foreign_page")
_COLUMNS = ["models", "agree", "files without a model"]


def agreement(tally: ForeignTally) -> str:
    """Return on how many models all paths agree."""
    models, agree = (sum(getattr(p, name) for p in tally.packages) for name in ("models", "agree"))
    return f"{agree} of {models} models"


def lines(tally: ForeignTally) -> Iterator[str]:
    """Yield the conclusion, a row for each package, and the models that do not agree."""
    yield (
        f"On {agreement(tally)} from {len(tally.packages)} packages, all"
        f" {len(tally.variants)} ways of stepping with MuJoCo {tally.mujoco}'s C engine reach"
        f" bit-identical states after {tally.nstep} steps of {tally.nbatch} simulations. They have"
        f" one thread or two. Measured on {tally.date}."
    )
    yield ""
    rows = (
        [f"{p.name} {p.version}", *map(str, (p.models, p.agree, p.files - p.models))]
        for p in tally.packages
    )
    yield from markdown.table_lines(["package", *_COLUMNS], rows, _COLUMNS)
    yield ""
    for package in tally.packages:
        for result in package.remarks:
            if result.outcome not in (Outcome.AGREES, *NO_MODEL):
                yield f"- `{result.file}` ({package.name}) {result.outcome}: {_text(result.detail)}"


def _text(text: str) -> str:
    """Return text that Markdown shows as it is."""
    return re.sub(r"([|*_<>`\\])", r"\\\1", text)


if __name__ == "__main__":
    from benchmarks.studies import foreign, foreign_tally

    PART.write(lines(foreign_tally.load(foreign.TALLY)))
