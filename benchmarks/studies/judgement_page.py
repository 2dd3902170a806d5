"""The page docs/judgements.md, written from the tally of `benchmarks.studies.judgements`."""

from collections.abc import Iterator

from benchmarks.studies.judgement_tally import JudgedModel, JudgementTally
from mjbench.results import markdown
from mjbench.simulation.accelerated_judgement import EngineAnswer
from mjbench.status import Status

_HEAD = (
    "# Do MJX and Warp compute what C does?",
    "",
    "Written by `python -m benchmarks.studies.judgements` from `results/judgements.json`;"
    " do not edit.",
    "",
)
_TAIL = (
    "",
    "A `close` names the pairs of geoms whose contacts differ, and how much that changes"
    " accelerations in nine of ten states. A `NO` beside small changes is of contacts that are"
    " missing in some state: [how parts are judged](method/accelerated.md#how-it-is-judged), [what"
    " that means for you](guides/mjx.md).",
)


def page(tally: JudgementTally) -> str:
    """Return the Markdown page of a tally."""
    return "\n".join(_lines(tally)) + "\n"


def _lines(tally: JudgementTally) -> Iterator[str]:
    yield from _HEAD
    yield _conclusion(tally)
    yield ""
    versions = ", ".join(f"{name} {version}" for name, version in sorted(_versions(tally).items()))
    yield f"{tally.nbatch} simulations of {tally.nstep} steps, on two cores of a CPU: {versions}."
    for is_shipped, heading in ((True, "Shipped models"), (False, "Models of other packages")):
        rows = [row for row in tally.rows if (row.package == "shipped") == is_shipped]
        if rows:
            yield from ("", f"## {heading}", "")
            yield from markdown.table_lines(
                ["model", "path", "answer", "what differs"],
                ([_name(row), row.path, _answer(row), _reason(row)] for row in rows),
            )
    yield from _TAIL


def _conclusion(tally: JudgementTally) -> str:
    counts = [
        f"{count} {answer.value}"
        for answer in EngineAnswer
        if (count := sum(_answer(row) == answer.value for row in tally.rows))
    ]
    refused = sum(row.status == Status.UNAVAILABLE for row in tally.rows)
    beside = f"; {refused} times the engine does not take the model" if refused else ""
    failed = len(tally.rows) - refused - sum(row.judgement is not None for row in tally.rows)
    beside += f"; {failed} failed, or reached a limit" if failed else ""
    return f"Of {len(tally.rows)} pairs of a model and a path: {', '.join(counts)}{beside}."


def _versions(tally: JudgementTally) -> dict[str, str]:
    versions = {"mujoco": tally.mujoco}
    for row in tally.rows:
        versions |= row.versions or {}
    return versions


def _name(row: JudgedModel) -> str:
    return row.model if row.package == "shipped" else f"{row.package}: {row.model}"


def _answer(row: JudgedModel) -> str:
    return row.judgement.answer.value if row.judgement is not None else row.status.value


def _reason(row: JudgedModel) -> str:
    return (row.judgement.reason if row.judgement is not None else row.detail).replace("|", "/")
