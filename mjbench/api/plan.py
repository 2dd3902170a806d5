"""What `mjbench plan` measures: plans of a sampling planner, by the path that rolls out."""

import itertools
from collections.abc import Sequence

from mjbench.api import session
from mjbench.api.session import Item, Items, Measurement, Observer
from mjbench.comparison import planning_run, selection
from mjbench.comparison.planning_run import PlanningRequest
from mjbench.comparison.sampling_planners import Algorithm, PlannerSettings
from mjbench.errors import MjbenchError
from mjbench.simulation.models import ModelSource
from mjbench.simulation.starts import StartPlan
from mjbench.store.runs import Record


def measurement(
    sources: Sequence[ModelSource],
    algorithm: str,
    samples: Sequence[int],
    knots: Sequence[int],
    hold: int,
    duration_s: float,
    path_names: Sequence[str] | None,
    threads: Sequence[int] | None,
    budget_s: float,
    seed: int,
    starts: StartPlan,
    import_from: str | None,
    limit_s: float,
) -> Measurement:
    """Return the measurement; `import_from`: folder of the user's own paths."""
    variants = selection.variants(path_names or [], threads)
    settings = [
        PlannerSettings(Algorithm(algorithm), nsample, nknot, seed=seed)
        for nsample, nknot in itertools.product(samples, knots)
    ]
    requests = [
        PlanningRequest(source, variants, each, hold, duration_s, starts.file, budget_s)
        for source, each in itertools.product(sources, settings)
    ]

    def measured(request: PlanningRequest) -> Item:
        try:
            return Item(planning_run.run(request, import_from, limit_s))
        except MjbenchError as error:
            return Item(failure=session.failure_of_model(request.source.name, error))

    def measure(earlier: Sequence[Record], observer: Observer) -> Items:
        for number, request in enumerate(requests):
            observer(request.source.name, number / len(requests))
            known = planning_run.stored(request, earlier)
            yield Item(known) if known else measured(request)

    def whole(records: Sequence[Record]) -> list[Record]:
        ended = session.finished(records)
        return [row for request in requests for row in planning_run.stored(request, ended)]

    arguments = {
        "models": [source.name for source in sources],
        "variants": variants,
        "settings": list(dict.fromkeys(settings)),
        "hold": hold,
        "duration_s": duration_s,
        "budget_s": budget_s,
        "starts": starts,
    }
    return Measurement("plan", arguments, session.input_files(sources, [], starts), measure, whole)
