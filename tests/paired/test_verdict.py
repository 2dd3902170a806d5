"""Verdicts: when they stop, how they fail, and what results say of them."""

from dataclasses import replace
from pathlib import Path

from paired_examples import BRIEF, CARTPOLE, INSTALLED

from mjbench.instrument import runs
from mjbench.instrument.stats import Verdict
from mjbench.paired import verdict
from mjbench.paired.preparation import Sizes
from mjbench.paired.targets import Target
from mjbench.paired.verdict import PairedResult
from mjbench.paired.worker_pool import WorkerPool
from mjbench.simulation import models
from mjbench.status import Status


def test_a_known_slowdown_is_a_share_of_the_simulations(pool: WorkerPool) -> None:
    candidate = replace(CARTPOLE, slowdown=1.0)
    plan = replace(BRIEF, sizes=Sizes(nbatch=4, nstep=50))
    result = verdict.decide(pool, CARTPOLE, candidate, plan)
    assert result.status == Status.OK
    assert result.judgement is not None
    assert result.judgement.ratio > 1.5  # twice the work


def test_time_runs_out_with_an_interval_and_no_verdict(pool: WorkerPool) -> None:
    ticks = iter(range(0, 10_000, 100))
    plan = verdict.VerdictPlan(time_limit_s=250.0)
    result = verdict.decide(pool, CARTPOLE, CARTPOLE, plan, clock=lambda: float(next(ticks)))
    assert result.judgement is not None
    assert result.judgement.verdict == Verdict.INCONCLUSIVE
    assert result.judgement.launches == 2
    record = result.record()
    assert record.launches == len(record.samples) == 2
    assert record.pairs == 2 * sum(len(sample.orders) for sample in record.samples)
    assert record.diverged is not None
    assert runs.to_json(record)["work"]["old"] == runs.to_json(record)["work"]["new"]


def test_a_target_in_which_every_simulation_diverges_is_bad_input(
    pool: WorkerPool, stiff: Target
) -> None:
    candidate = replace(stiff, model_options={"timestep": "0.0025"})
    plan = replace(BRIEF, sizes=Sizes(nbatch=4, nstep=50))
    result = verdict.decide(pool, stiff, candidate, plan)
    assert result.status == Status.INPUT
    assert "every simulation diverges (BADQACC in 4)" in result.detail


def test_a_model_that_does_not_load_is_bad_input(pool: WorkerPool, tmp_path: Path) -> None:
    file = tmp_path / "empty.xml"
    file.write_text("")
    target = Target(INSTALLED, models.resolve(str(file)))
    result = verdict.decide(pool, target, target, BRIEF)
    assert result.status == Status.INPUT
    assert result.detail.startswith("baseline (MuJoCo")
    assert "cannot load it" in result.detail


def test_a_comparison_that_measured_nothing_says_so_with_none() -> None:
    row = PairedResult(CARTPOLE, CARTPOLE, Status.FAILED, "killed").row()
    assert (row.status, row.detail, row.model) == (Status.FAILED, "killed", "cartpole")
    assert (row.verdict, row.ratio, row.changed_work, row.work) == (None, None, None, None)
    assert (row.drift, row.diverged, row.nbatch, row.nstep) == (None, None, None, None)
    assert (row.launches, row.pairs) == (0, 0)
