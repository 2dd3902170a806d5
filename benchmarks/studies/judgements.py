"""Judges MJX and Warp on the shipped models and on models of other packages, one path at a time.

    python -m benchmarks.studies.judgements [MODEL …] [--paths mjx64,warp] [--page]

A model is a shipped name, or PACKAGE:FILE of a wheel that `make foreign` has downloaded. Without
any, all shipped models. It writes results/judgements.json after each path, and its part
of docs/results.md; models that are named replace their rows. A path takes one to five minutes, most
of which compiles.
"""

import dataclasses
import sys
import tempfile
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path

from benchmarks.studies import foreign_packages, judgement_page, tally_command, tally_file
from benchmarks.studies.judgement_tally import JudgedModel, JudgementTally, load, save_states
from mjbench.commands.compare import accelerated_measurement
from mjbench.commands.compare.accelerated_measurement import AcceleratedRequest
from mjbench.errors import failure_of
from mjbench.host import isolate
from mjbench.simulation import models
from mjbench.simulation.models import ModelSource
from mjbench.status import ExitCode, Status
from mjbench.verification.plan import Variant
from mjbench.verification.records import VariantRecord

ROOT = Path(__file__).resolve().parents[2]
TALLY = ROOT / "results" / "judgements.json"
PATHS = ("mjx", "mjx64", "warp")
NBATCH, NSTEP, LIMIT_S = 16, 50, 240.0


def judged(package: str, source: ModelSource, path: str, limit_s: float) -> JudgedModel:
    """Judge a path on a model, in a child process."""
    records = [VariantRecord.of(source.name, Variant(path, {}))]
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "workload.pickle"
        resolved = ModelSource(source.name, source.path.resolve())
        try:
            isolate.call(save_states, resolved, file, NBATCH, NSTEP, limit_s=limit_s)
            request = AcceleratedRequest(resolved, Variant(path, {}), file, limit_s=limit_s)
            ended = accelerated_measurement.run(request, records.append)
        except Exception as error:  # a model's or an engine's own
            failure = failure_of(error)
            ended = isolate.Ended(failure.status, failure.detail)
    last = records[-1]
    if ended.status != Status.OK:
        last = dataclasses.replace(last, status=ended.status, detail=ended.detail)
    return JudgedModel.of(package, last)


def run(names: Sequence[str], paths: Sequence[str], limit_s: float) -> None:
    """Judge paths on models; store each as it comes."""
    tally = load(TALLY) if TALLY.exists() else JudgementTally(version("mujoco"), NBATCH, NSTEP, ())
    for name in names or models.shipped():
        package, source = foreign_packages.find(name)
        for path in paths:
            row = judged(package, source, path, limit_s)
            answer = row.judgement.answer if row.judgement else row.status
            print(f"{name}: {path}: {answer}: {row.detail}", flush=True)
            tally = tally.with_row(row)
            save(tally)


def save(tally: JudgementTally) -> None:
    """Write the tally and the page."""
    tally_file.write(TALLY, tally)
    judgement_page.PART.write(judgement_page.lines(tally))


def main(arguments: Sequence[str] | None = None) -> ExitCode:
    """Run the command; return its exit code."""
    parser = tally_command.parser(__doc__)
    parser.add_argument("models", nargs="*")
    parser.add_argument("--paths", default=",".join(PATHS), help="paths that compile")
    parser.add_argument("--time-limit", type=float, default=LIMIT_S, help="seconds without a word")
    parser.add_argument("--page", action="store_true", help="only write the page again")
    options = parser.parse_args(arguments)

    def action() -> ExitCode:
        if options.page:
            save(load(TALLY))
        else:
            run(options.models, options.paths.split(","), options.time_limit)
        return ExitCode.OK

    return tally_command.run("judgements", action, "the tally has what was judged")


if __name__ == "__main__":
    sys.exit(main())
