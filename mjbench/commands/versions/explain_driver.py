"""What `mjbench versions --explain` measures: times, then instructions by function."""

import functools
from collections.abc import Sequence
from dataclasses import asdict, replace

from mjbench.commands.versions.options import ExplainOptions
from mjbench.counts.explain import explain_change
from mjbench.counts.instructions import InstructionCounter
from mjbench.counts.records import ExplainRecord
from mjbench.errors import InputError
from mjbench.paired import verdict
from mjbench.paired.records import VerdictRow
from mjbench.paired.targets import Target
from mjbench.paired.worker_pool import WorkerPool
from mjbench.releases.release_names import ReleaseSpec
from mjbench.results.runs import Record
from mjbench.session import Item, Items, Measurement, Observer, finished, input_files
from mjbench.simulation.models import ModelSource


def of_change(
    specs: Sequence[ReleaseSpec], sources: Sequence[ModelSource], options: ExplainOptions
) -> Measurement:
    """Return the measurement of what changed from one release to another.

    Raises:
      InputError: there are more than two releases.
    """
    if len(specs) > 2:
        raise InputError("--explain compares one OLD and one NEW release")
    plan = options.plan

    def measure(earlier: Sequence[Record], observer: Observer) -> Items:
        known = {each.model for each in earlier if isinstance(each, ExplainRecord)}
        remaining = [source for source in sources if source.name not in known]
        with WorkerPool() as pool, InstructionCounter(plan.sizes) as counter:
            # workloads last as long as the pool, and are those that the counter counts
            times: list[VerdictRow | None] = []
            shares = plan.budget.divided(2 * len(remaining))  # counts take as long, about
            for number, source in enumerate(remaining):
                observer(f"{source.name}: time", number / len(remaining) / 2)
                timed = replace(plan, time_limit_s=shares.next_s())
                if options.skip:
                    times.append(None)
                    continue
                use_workload = functools.partial(counter.use_workload, source)
                old, new = (Target(spec, source) for spec in specs)
                record = verdict.decide_pair(pool, old, new, timed, use_workload=use_workload)
                times.append(record.uninterrupted().row())
            observer("instructions", 0.5)
            baselines, candidates = (list(counter.count(spec, remaining)) for spec in specs)
            for baseline, candidate, time in zip(baselines, candidates, times, strict=True):
                yield Item([explain_change(baseline, candidate, time)])

    arguments = {
        **asdict(plan),
        "releases": [spec.key for spec in specs],
        "models": [source.name for source in sources],
        "skip": options.skip,
    }
    return Measurement(
        "explain", arguments, input_files(sources, specs, plan.sizes.starts), measure, finished
    )
