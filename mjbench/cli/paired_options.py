"""What the commands around paired comparisons share: `versions`, `ab` and others."""

from collections.abc import Iterable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from mjbench.cli.context import OutputOptions, RunContext, Storage
from mjbench.cli.fail_on import FailOn
from mjbench.cli.group import report_line
from mjbench.cli.shared import check_sizes, start_plan
from mjbench.errors import InputError, shown, suggestion
from mjbench.host import platforms
from mjbench.paired.outcomes import Metric
from mjbench.status import ExitCode, Status

if TYPE_CHECKING:
    from mjbench.paired.records import VerdictRow
    from mjbench.paired.targets import Target
    from mjbench.paired.verdict import VerdictPlan
    from mjbench.simulation.models import ModelSource


def releases_and_models(names: Sequence[str]) -> tuple[list[str], list["ModelSource"]]:
    """Return the releases among names, and the models of the others; without any, all shipped."""
    from mjbench.releases import installs
    from mjbench.simulation import models

    release_names = [name for name in names if installs.is_release(name)]
    model_names = [name for name in names if name not in release_names]
    return release_names, [_model(name) for name in model_names or models.shipped()]


def _model(name: str) -> "ModelSource":
    """Return the model that a word names where releases are named too."""
    from mjbench.releases import installs, wheels
    from mjbench.simulation import models

    try:
        return models.resolve(name)
    except models.UnknownModelError:
        known = [installs.INSTALLED, installs.NEWEST, installs.PREVIOUS, *models.shipped()]
        raise InputError(
            f"{shown(name)} is neither a release nor a model{suggestion(name, known)}:"
            f" a release is {installs.FORMS}; a model is one of {', '.join(models.shipped())},"
            f" {models.FORMS}"
        ) from None
    except InputError:
        if not wheels.is_folder(name):
            raise
        raise InputError(
            f"{shown(name)} is a folder without wheels; name wheels of mujoco, or a model's file"
        ) from None


def warn_if_unpinned() -> None:
    """Say that this system cannot keep processes on a core, where it cannot."""
    problem = platforms.pinning_problem()
    if problem:
        report_line(problem)


def verdict_plan(
    *,
    min_effect: float,
    confidence: float,
    precision: float,
    time_limit: float,
    nbatch: int | None,
    nstep: int | None,
    hold: int,
    seed: int,
    as_shipped: bool,
    settle_s: float | None,
    states_file: Path | None,
    actions_file: Path | None,
    metric: Metric = Metric.TIME,
) -> "VerdictPlan":
    """Return the plan that the options JUDGING and SIZES ask for, to compare a metric.

    Raises:
      InputError: nstep is not a multiple of hold, or start states cannot be had as asked.
    """
    from mjbench.paired.run_sizes import Sizes
    from mjbench.paired.verdict import VerdictPlan

    check_sizes(nstep, hold)
    starts = start_plan(settle_s, states_file, actions_file)
    sizes = Sizes(nbatch, nstep, hold, seed, starts, metric=metric)
    return VerdictPlan(min_effect, confidence, precision, time_limit, sizes, as_shipped)


def compare_targets(
    command: str,
    pairs: Sequence[tuple["Target", "Target"]],
    plan: "VerdictPlan",
    fail_on: FailOn,
    output: OutputOptions,
) -> ExitCode:
    """Compare pairs of targets, print and store the verdicts; return the exit code.

    Args:
      pairs: baseline and candidate of each comparison.
    """
    from mjbench.paired import records, verdict
    from mjbench.paired.worker_pool import WorkerPool

    warn_if_unpinned()
    targets = [target for pair in pairs for target in pair]
    arguments = {**asdict(plan), "targets": [target.row() for target in targets]}
    storage = Storage(output.results, arguments, output.resume, records.finished)
    files = [*input_files(targets), *plan.sizes.starts.files]
    with RunContext(command, output.json_file, files, storage, output.wait) as run:
        finished = records.finished(run.resumed_records)
        rows, missing = [record.row() for record in finished], verdict.missing(pairs, finished)
        with run.progress(len(missing)) as advance, WorkerPool() as pool:
            for result in verdict.decide_each(pool, missing, plan, advance):
                run.record(result.record())
                rows.append(result.row())
        report(run, rows, plan.confidence)
    return fail_on.exit_code(rows, plan.confidence)


def input_files(targets: Iterable["Target"]) -> list[Path]:
    """Return the files that targets are made of: models, and wheels of releases."""
    return [path for t in targets for path in (t.model.path, *t.release.wheels)]


def report(run: RunContext, rows: Sequence["VerdictRow"], confidence: float) -> None:
    """Print verdicts, and write the JSON document."""
    from mjbench.report import verdicts
    from mjbench.report.kinds import VERDICT

    if any(row.status == Status.INTERRUPTED for row in rows):
        run.interrupt()
    run.show([verdicts.section(rows, confidence)])
    run.write(VERDICT.document_type(machine=run.machine, results=rows))
