"""Does each metric find what it is of, and nothing where nothing differs?

    python -m benchmarks.studies.metric_checks [--pairs 20] [--metric load]… [--json FILE]

compares a model with itself by each metric that is measured in pairs, 20 times; none may be called
different. Before that, it plants what a metric has to find and other metrics must not: a file that
takes longer to load, with the same model in it; a step that does more; and a step of MJX whose
tracing takes longer, although the program is the same.

A comparison takes ten seconds to a minute; of compiling, five minutes. FILE is written after each
one, and keeps what it has of metrics that are not measured. The exit code is 1 if something is
missed or falsely called different, and 0 otherwise.
"""

import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from importlib import metadata
from pathlib import Path

from benchmarks.studies import tally_command, tally_file
from benchmarks.verdicts.planted import slowed_run
from mjbench.commands.versions import accelerated_environments, function_verdict
from mjbench.commands.versions.accelerated_environments import AcceleratedComparison
from mjbench.commands.versions.function_sides import FunctionTargets
from mjbench.paired import verdict
from mjbench.paired.metrics import METRICS, Metric
from mjbench.paired.outcomes import Verdict
from mjbench.paired.records import VerdictRow
from mjbench.paired.run_sizes import Sizes
from mjbench.paired.targets import Target
from mjbench.paired.verdict import VerdictPlan
from mjbench.paired.worker_pool import WorkerPool
from mjbench.releases import release_names
from mjbench.simulation import models
from mjbench.simulation.models import ModelSource
from mjbench.status import ExitCode, Status

MODEL = "cartpole"
# Of a comment that makes the file longer to parse; and a function that each step calls once more.
COMMENT_BYTES, CALLBACK = 200_000, "mj_factorM"
PAIRED = tuple(m for m, spec in METRICS.items() if not spec.is_exact)
# The path that compiles; seconds that a comparison of compiling may take, and of silence.
ENGINE, COMPILING_S, PATIENCE_S = "mjx", 300.0, 600.0
# Without constraints, MJX compiles it in a few seconds.
PENDULUM = """
<mujoco>
  <worldbody>
    <body>
      <joint name="hinge" axis="0 1 0"/>
      <geom fromto="0 0 0 0 0 -.5" size=".02" type="capsule" contype="0" conaffinity="0"/>
    </body>
  </worldbody>
  <actuator>
    <motor joint="hinge"/>
  </actuator>
</mujoco>
"""
# Has the tracing of every step take longer; the program is the same.
SLOWLY_TRACED = """
import time
from mujoco import mjx
step_as_it_is = mjx.step
def step_slowly_traced(model, data):
    time.sleep(2)
    return step_as_it_is(model, data)
mjx.step = step_slowly_traced
"""


@dataclass(frozen=True)
class CompiledModel:
    """The pendulum by MJX, in one environment.

    Attributes:
      prelude: what its process runs first.
    """

    prelude: str = ""


@dataclass(frozen=True)
class Case:
    """A comparison by one metric.

    Attributes:
      checks: the metric whose check it belongs to: another one must not find what it finds.
      is_slower: whether the metric has to call the candidate slower; else it must be the same.
    """

    name: str
    checks: Metric
    metric: Metric
    candidate: Target | CompiledModel
    is_slower: bool


@dataclass(frozen=True)
class Result:
    """What a comparison came to, as the JSON file has it."""

    case: str
    checks: Metric
    is_slower: bool
    verdict: VerdictRow


def baseline() -> Target:
    """Return the model as it is, in the installed release."""
    return Target(release_names.parse_release(release_names.INSTALLED), models.resolve(MODEL))


def planted(folder: Path, metrics: Sequence[Metric]) -> Iterator[Case]:
    """Yield what one metric has to find, and what all others must not."""
    same = baseline()
    text = same.model.path.read_text()
    file = folder / f"{MODEL}.xml"
    comment = "<!--" + " word" * (COMMENT_BYTES // 5) + "-->"
    file.write_text(text.replace("</mujoco>", f"{comment}</mujoco>"))
    longer = replace(same, model=ModelSource(MODEL, file))
    heavier = replace(same, prepare_run=slowed_run(callback=CALLBACK))
    for metric in metrics:
        if metric == Metric.COMPILE:
            slower = CompiledModel(SLOWLY_TRACED)
            yield Case("slower tracing", metric, Metric.COMPILE, slower, is_slower=True)
            yield Case("slower tracing", metric, Metric.TIME, slower, is_slower=False)
            continue
        yield Case("a longer file", metric, metric, longer, is_slower=metric == Metric.LOAD)
        if metric in (Metric.TIME, Metric.LOAD, Metric.RESET):
            yield Case("a heavier step", metric, metric, heavier, metric == Metric.TIME)


def unchanged(metrics: Sequence[Metric], pairs: int) -> Iterator[Case]:
    """Yield a model against itself, as often as asked for by each metric."""
    for metric in metrics:
        candidate = CompiledModel() if metric == Metric.COMPILE else baseline()
        for number in range(pairs):
            yield Case(f"itself, {number + 1}", metric, metric, candidate, is_slower=False)


def decide(pool: WorkerPool, case: Case) -> VerdictRow:
    """Return the verdict on a case."""
    plan = VerdictPlan(sizes=Sizes(metric=case.metric), as_shipped=True)
    if isinstance(case.candidate, Target):
        return verdict.decide_pair(pool, baseline(), case.candidate, plan).row()
    plan = replace(plan, time_limit_s=COMPILING_S)
    targets = _compiled(pool, case.candidate, plan.sizes)
    return function_verdict.decide_function(pool, targets, plan).row()


def _compiled(pool: WorkerPool, model: CompiledModel, sizes: Sizes) -> FunctionTargets:
    """Return the pendulum as it is, and after a prelude, with the versions that are installed."""
    file = pool.new_folder() / "pendulum.xml"
    file.write_text(PENDULUM)
    names = ("jax", "jaxlib", "mujoco-mjx")
    spec = release_names.parse_release(
        ",".join(f"{name}=={metadata.version(name)}" for name in names)
    )
    sources = [ModelSource("pendulum", file)]
    comparison = AcceleratedComparison([spec, spec], sources, [ENGINE], sizes)
    ((old, new),) = accelerated_environments.prepare_targets(pool, comparison)
    assert new.source.text is not None, "it has a module of its own"
    source = replace(new.source, text=model.prelude.encode() + new.source.text)
    # two sides that seem to be the same are not timed
    return old, replace(new, source=source, tree="again")


def is_wrong(case: Case, row: VerdictRow) -> bool:
    """Return whether something was missed or falsely named, or nothing was measured."""
    if row.status != Status.OK or row.verdict is None:
        return True
    if case.is_slower:
        return row.verdict != Verdict.SLOWER
    return row.verdict not in (Verdict.SAME, Verdict.INCONCLUSIVE)


def main(arguments: Sequence[str] | None = None) -> ExitCode:
    """Run the command; return its exit code."""
    parser = tally_command.parser(__doc__)
    parser.add_argument("--pairs", type=int, default=20, help="of a model with itself, by metric")
    parser.add_argument("--metric", action="append", choices=[*PAIRED], help="all without it")
    parser.add_argument("--json", type=Path, help="file for what was measured")
    options = parser.parse_args(arguments)
    # late: asv imports this module where few packages are
    from mjbench.commands.versions.show import describe_verdict

    metrics = [Metric(name) for name in options.metric or PAIRED]
    earlier = list[Result]()
    if options.json and options.json.exists():
        stored = tally_file.load(options.json, list[Result], "metrics")
        earlier = [each for each in stored if each.checks not in metrics]
    results, wrong = list[Result](), 0
    with tempfile.TemporaryDirectory() as folder, WorkerPool(PATIENCE_S) as pool:
        for case in (*planted(Path(folder), metrics), *unchanged(metrics, options.pairs)):
            row = decide(pool, case)
            mark = "WRONG: " if is_wrong(case, row) else ""
            wrong += bool(mark)
            print(f"{mark}{case.name}, {case.metric}: {describe_verdict(row)}", flush=True)
            print(f"    {row.launches} launches, {row.seconds:.0f} s", flush=True)
            results.append(Result(case.name, case.checks, case.is_slower, row))
            if options.json:
                tally_file.write(options.json, [*earlier, *results])
    print(f"{wrong} of {len(results)} comparisons are wrong")
    return ExitCode.FINDING if wrong else ExitCode.OK


if __name__ == "__main__":
    sys.exit(main())
