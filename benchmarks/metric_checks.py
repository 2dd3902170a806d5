"""Does each metric find what it is of, and nothing where nothing differs?

    python -m benchmarks.metric_checks [--pairs 20] [--metric load]… [--json FILE]

compares a model with itself by each metric that is measured in pairs, 20 times; none may be called
different. Before that, it plants what a metric has to find and other metrics must not: a file that
takes longer to load, with the same model in it, and a step that does more.

A comparison takes ten seconds to a minute. The exit code is 1 if something is missed or falsely
called different, and 0 otherwise.
"""

import argparse
import json
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from mjbench.paired import verdict
from mjbench.paired.metrics import METRICS, Measured
from mjbench.paired.outcomes import Metric, Verdict
from mjbench.paired.records import VerdictRow
from mjbench.paired.run_sizes import Sizes
from mjbench.paired.targets import Target
from mjbench.paired.verdict import VerdictPlan
from mjbench.paired.worker_pool import WorkerPool
from mjbench.releases import installs
from mjbench.simulation import models
from mjbench.simulation.models import ModelSource
from mjbench.status import ExitCode, Status

MODEL = "cartpole"
# Of a comment that makes the file longer to parse; and a function that each step calls once more.
COMMENT_BYTES, CALLBACK = 200_000, "mj_factorM"
_OTHERS = (Measured.COUNTS, Measured.COMPILATION)
PAIRED = tuple(m for m, spec in METRICS.items() if spec.measured not in _OTHERS)


@dataclass(frozen=True)
class Case:
    """A comparison by one metric.

    Attributes:
      is_slower: whether the metric has to call the candidate slower; else it must be the same.
    """

    name: str
    metric: Metric
    candidate: Target
    is_slower: bool


@dataclass(frozen=True)
class Result:
    """What a comparison came to, as the JSON file has it."""

    case: str
    is_slower: bool
    verdict: VerdictRow


def baseline() -> Target:
    """Return the model as it is, in the installed release."""
    return Target(installs.parse_release(installs.INSTALLED), models.resolve(MODEL))


def planted(folder: Path, metrics: Sequence[Metric]) -> Iterator[Case]:
    """Yield what one metric has to find, and what all others must not."""
    same = baseline()
    text = same.model.path.read_text()
    file = folder / f"{MODEL}.xml"
    comment = "<!--" + " word" * (COMMENT_BYTES // 5) + "-->"
    file.write_text(text.replace("</mujoco>", f"{comment}</mujoco>"))
    longer = replace(same, model=ModelSource(MODEL, file))
    heavier = replace(same, callback=CALLBACK)
    for metric in metrics:
        yield Case("a longer file", metric, longer, is_slower=metric == Metric.LOAD)
        if metric in (Metric.TIME, Metric.P99, Metric.LOAD, Metric.RESET):
            slower = metric in (Metric.TIME, Metric.P99)
            yield Case("a heavier step", metric, heavier, is_slower=slower)


def unchanged(metrics: Sequence[Metric], pairs: int) -> Iterator[Case]:
    """Yield a model against itself, as often as asked for by each metric."""
    for metric in metrics:
        for number in range(pairs):
            yield Case(f"itself, {number + 1}", metric, baseline(), is_slower=False)


def is_wrong(case: Case, row: VerdictRow) -> bool:
    """Return whether something was missed or falsely named, or nothing was measured."""
    if row.status != Status.OK or row.verdict is None:
        return True
    if case.is_slower:
        return row.verdict != Verdict.SLOWER
    return row.verdict not in (Verdict.SAME, Verdict.INCONCLUSIVE)


def main(arguments: Sequence[str] | None = None) -> ExitCode:
    """Run the command; return its exit code."""
    assert __doc__ is not None
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--pairs", type=int, default=20, help="of a model with itself, by metric")
    parser.add_argument("--metric", action="append", choices=[*PAIRED], help="all without it")
    parser.add_argument("--json", type=Path, help="file for what was measured")
    options = parser.parse_args(arguments)
    # late: asv imports this module where few packages are
    from mjbench.report.verdicts import describe_verdict
    from mjbench.store.json_form import json_form

    metrics = [Metric(name) for name in options.metric or PAIRED]
    results, wrong = list[Result](), 0
    with tempfile.TemporaryDirectory() as folder, WorkerPool() as pool:
        for case in (*planted(Path(folder), metrics), *unchanged(metrics, options.pairs)):
            plan = VerdictPlan(sizes=Sizes(metric=case.metric), as_shipped=True)
            row = verdict.decide(pool, baseline(), case.candidate, plan).row()
            mark = "WRONG: " if is_wrong(case, row) else ""
            wrong += bool(mark)
            print(f"{mark}{case.name}, {case.metric}: {describe_verdict(row)}", flush=True)
            print(f"    {row.launches} launches, {row.seconds:.0f} s", flush=True)
            results.append(Result(case.name, case.is_slower, row))
    print(f"{wrong} of {len(results)} comparisons are wrong")
    if options.json:
        options.json.write_text(json.dumps(json_form(results), indent=1) + "\n")
    return ExitCode.FINDING if wrong else ExitCode.OK


if __name__ == "__main__":
    sys.exit(main())
