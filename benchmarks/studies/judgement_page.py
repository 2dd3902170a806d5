"""What docs/results.md has of the tally of `benchmarks.studies.judgements`."""

from collections.abc import Iterator

from benchmarks.studies.judgement_tally import JudgedModel, JudgementTally
from benchmarks.studies.page_part import PagePart
from mjbench.results import markdown
from mjbench.simulation.accelerated_judgement import EngineAnswer
from mjbench.status import Status

PART = PagePart("results.md", "judgements", "benchmarks.studies.judgements")


def lines(tally: JudgementTally) -> Iterator[str]:
    """Yield the conclusion, then the answers on each model."""
    paths = list(dict.fromkeys(row.path for row in tally.rows))
    answers: dict[str, dict[str, str]] = {}
    for row in tally.rows:
        answers.setdefault(_name(row), {})[row.path] = _answer(row)
    versions = ", ".join(f"{name} {version}" for name, version in sorted(_versions(tally).items()))
    yield _conclusion(tally)
    yield (
        f"{tally.nbatch} simulations of {tally.nstep} steps from near keyframe 0, on two CPU cores:"
        f" {versions}."
    )
    yield ""
    rows = ([name, *(of.get(path, "") for path in paths)] for name, of in answers.items())
    yield from markdown.table_lines(["model", *paths], rows)


def _conclusion(tally: JudgementTally) -> str:
    counts = [
        f"{count} {answer.value}"
        for answer in EngineAnswer
        if (count := sum(_answer(row) == answer.value for row in tally.rows))
    ]
    refused = sum(row.status == Status.UNAVAILABLE for row in tally.rows)
    failed = len(tally.rows) - refused - sum(row.judgement is not None for row in tally.rows)
    counts += [f"{n} {name}" for n, name in ((refused, "unavailable"), (failed, "failed")) if n]
    return f"Of {len(tally.rows)} pairs of a model and a path: {', '.join(counts)}."


def _versions(tally: JudgementTally) -> dict[str, str]:
    versions = {"mujoco": tally.mujoco}
    for row in tally.rows:
        versions |= row.versions or {}
    return versions


def _name(row: JudgedModel) -> str:
    if row.package == "shipped":
        return row.model
    return f"{row.package}: {row.model.removesuffix('.xml').partition('/')[2]}"


def _answer(row: JudgedModel) -> str:
    return row.judgement.answer.value if row.judgement is not None else row.status.value
