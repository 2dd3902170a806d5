"""What is shown of the judgements of MJX and Warp: a sentence, two tables, and versions."""

from collections.abc import Sequence

from mjbench import formats, paths
from mjbench.commands.compare.results import PathResult
from mjbench.formats import listed, plain
from mjbench.releases.release import version_key
from mjbench.results.content import Column, DataTable
from mjbench.simulation.accelerated_judgement import EngineAnswer, JudgedPart, Measure


def judgement_tables(results: Sequence[PathResult]) -> list[DataTable]:
    """Return what was judged of accelerated paths."""
    judged = [(r.path, r.judgement) for r in results if r.judgement and r.judgement.parts]
    parts = DataTable.of(
        "Judged parts",
        [(path, part) for path, judgement in judged for part in judgement.parts],
        (Column("judged"), lambda row: row[0]),
        (Column("part"), lambda row: row[1].name.value),
        (Column("answer"), lambda row: row[1].answer.value),
        (Column("nearest to its limit", wraps=True), lambda row: _decisive(row[1])),
    )
    contacts = DataTable.of(
        "Contacts",
        [(path, pair) for path, judgement in judged for pair in judgement.pairs],
        (Column("contacts of"), lambda row: row[0]),
        (Column("geoms"), lambda row: "–".join(row[1].types)),
        (Column("states", formats.count, leaves=1), lambda row: row[1].states),
        (Column("contacts", formats.tenths), lambda row: row[1].count),
        (Column("in C", formats.tenths), lambda row: row[1].count_in_c),
        (
            Column("apart mm", lambda metres: _significant(1000 * metres), leaves=3),
            lambda row: row[1].position_m,
        ),
        (Column("normals °", _significant, leaves=2), lambda row: row[1].normal_degrees),
        (Column("acceleration", _share, leaves=4), lambda row: row[1].effect),
        (Column("largest", _share), lambda row: row[1].largest_effect),
        (Column("answer"), lambda row: row[1].answer.value),
    )
    return [parts, contacts]


def _decisive(part: JudgedPart) -> str:
    """Return the measure that is nearest to its limit, or the reason of a part without any."""
    limited = [each for each in part.measures if each.limit is not None]
    return str(max(limited, key=_closeness)) if limited else part.reason


def _closeness(measure: Measure) -> float:
    if measure.value is None or measure.limit is None:
        return float("inf")
    if measure.limit == 0:
        return float("inf") if measure.value else 0.0
    return measure.value / measure.limit


def _significant(value: float) -> str:
    return plain(value, 2) if value >= 1e-6 else "0"


def _share(share: float) -> str:
    return f"{_significant(100 * share)} %"


def judgement_conclusion(result: PathResult) -> str | None:
    """Return whether a path computes what C does, and how fast; None where that is not its matter.

    What disagrees is said with the other paths that do.
    """
    judgement = result.judgement
    if judgement is None or judgement.answer == EngineAnswer.NO:
        return None
    name = paths.title(result.path)
    if judgement.answer == EngineAnswer.NOT_JUDGED:
        return f"{name} is not judged: {judgement.reason}"
    same = "computes what C does"
    if judgement.answer == EngineAnswer.CLOSE:
        same = f"computes what C does but for {judgement.reason}"
    if result.speedup is None:
        return f"{name} {same}"
    speedup = formats.factor(result.speedup.estimate)
    return f"{name} {same}; {speedup} times the plain loop's speed on {result.device}"


def version_lines(results: Sequence[PathResult]) -> list[str]:
    versions: dict[str, str] = {}
    for result in results:
        versions |= result.versions or {}
    if not versions:
        return []
    named = listed([f"{name} {version}" for name, version in sorted(versions.items())])
    mujoco = versions.get("mujoco", "0")
    older = [
        f" {name} {version} is older than MuJoCo {mujoco}, which the C paths run."
        for name, version in versions.items()
        if name in _ENGINES and version_key(version) < version_key(mujoco)
    ]
    return [f"Computed by {named}.{''.join(older)}"]


# Packages that are released with MuJoCo, under its version.
_ENGINES = ("mujoco-mjx", "mujoco-warp")
