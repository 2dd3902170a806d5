"""How many threads a path should have, where paths with several numbers of threads raced."""

from collections.abc import Sequence
from dataclasses import dataclass

from mjbench.measuring.ratio import Ratio
from mjbench.paired.race_record import RaceRecord
from mjbench.paths.parallelism import nthread
from mjbench.report.results import ModelResults, PathResult

# A number of threads is enough where it reaches this share of the best speed-up.
ENOUGH = 0.95
# Of two numbers, one and all cores, the table says it all.
_LEAST_COUNTS = 3


@dataclass(frozen=True, kw_only=True)
class ThreadAdvice:
    """How many threads a path should have on a model.

    Attributes:
      nthread: the smallest number of threads that has `ENOUGH` of the best speed-up; 1 where no
        number is certainly faster than one thread.
      most_tried: the largest number that was tried.
      over_one: speed-up of `nthread` threads over one; None for one thread.
      chunk: simulations that a thread takes at a time; None for the path's own number.
      is_certain: whether the race had the time that it needed, and nothing disturbed it.
    """

    model: str
    nbatch: int | None
    path: str
    nthread: int
    most_tried: int
    over_one: Ratio | None
    chunk: int | None
    is_certain: bool


def advise_threads(model_results: ModelResults) -> list[ThreadAdvice]:
    """Return the advice on each path of which one thread and two other numbers were timed.

    There is none without a race, as in files of earlier versions.
    """
    race = model_results.race
    if race is None:
        return []
    timed = [r for r in model_results.results if r.is_timed and not r.is_accelerated]
    advice = []
    for name in dict.fromkeys(result.path for result in timed):
        own = [result for result in timed if result.path == name]
        counts = {nthread(result.options) for result in own}
        if len(counts) >= _LEAST_COUNTS and 1 in counts:
            advice.append(_advice(race, own))
    return advice


def _advice(race: RaceRecord, own: Sequence[PathResult]) -> ThreadAdvice:
    fastest: dict[int, PathResult] = {}
    for result in own:
        count = nthread(result.options)
        if count not in fastest or result.rate_over(fastest[count]) > 1:
            fastest[count] = result
    best = max(fastest.values(), key=lambda result: result.steps_per_s or 0.0)
    enough = min(n for n, result in fastest.items() if result.rate_over(best) >= ENOUGH)
    over_one = race.ratio(fastest[enough].variant, fastest[1].variant) if enough > 1 else None
    if over_one is None or not over_one.is_above(1.0):
        enough, over_one = 1, None
    chosen = fastest[enough]
    return ThreadAdvice(
        model=chosen.model,
        nbatch=chosen.nbatch,
        path=chosen.path,
        nthread=enough,
        most_tried=max(fastest),
        over_one=over_one,
        chunk=chosen.options.get("chunk"),
        is_certain=race.is_decided and not (race.is_cut_short or chosen.disturbances),
    )
