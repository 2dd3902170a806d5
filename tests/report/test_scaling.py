"""What is advised from a search for the number of threads."""

import dataclasses
from io import StringIO

import pytest
from example_records import measurement, model_record
from rich.console import Console

from mjbench.comparison.scaling import ScalingRecord, Stage
from mjbench.instrument.topology import Topology
from mjbench.paired.confirmation import ConfirmationRecord
from mjbench.paired.records import Ratio
from mjbench.report.scaling import print_results
from mjbench.report.thread_advice import ScalingResults, by_model
from mjbench.status import Status

NOISE = (1.0, 1.01, 0.99, 1.02, 0.98, 1.0, 1.01, 0.99)
ONE = {"threads": 1}
TWO = {"threads": 2, "pool": "kept"}
TOPOLOGY = Topology(2, 2, (2,))


def run(stage: Stage, nbatch: int, *speeds: tuple[dict[str, object], float]) -> ScalingRecord:
    """Return a run of rollout, by options and speed-up over the plain loop."""
    sizes = {"nbatch": nbatch, "nbatch_asked": nbatch, "nstep": 10}
    rows = [("python_loop", {}, 1.0), *(("rollout", options, speed) for options, speed in speeds)]
    return ScalingRecord(
        stage=stage,
        topology=TOPOLOGY,
        model=model_record(cores_had=[1.9, 2.0, 1.8], usable_cores=2, **sizes),
        measurements=[
            measurement(
                path=path,
                options=options,
                samples_s=[1e-3 * noise / speed for noise in NOISE],
                snippet=f"# {path} {options}",
                **sizes,
            )
            for path, options, speed in rows
        ],
    )


def confirmation(
    baseline: dict[str, object], candidate: dict[str, object], estimate: float, error: float = 0.02
) -> ConfirmationRecord:
    return ConfirmationRecord(
        model="m",
        nbatch_asked=64,
        baseline="rollout",
        baseline_options=baseline,
        candidate="rollout",
        candidate_options=candidate,
        status=Status.OK,
        ratio=Ratio(estimate=estimate, low=estimate - error, high=estimate + error),
    )


SEARCH = (
    run(Stage.THREADS, 64, (ONE, 1.1), (TWO, 2.0), ({**TWO, "threads": 4}, 1.95)),
    run(Stage.NBATCH, 4, (ONE, 1.0), (TWO, 1.2)),
    run(Stage.NBATCH, 256, (ONE, 1.1), (TWO, 2.05)),
)


def printed(results: ScalingResults, code: bool = False) -> str:
    text = StringIO()
    print_results(Console(file=text, width=160), results, code)
    return text.getvalue()


def test_the_smallest_number_that_is_certainly_faster_is_advised() -> None:
    results = ScalingResults(SEARCH)
    pairing = results.next_pairing()
    assert pairing is not None
    assert (pairing.baseline.options, pairing.candidate.options) == (ONE, TWO)
    results = ScalingResults(SEARCH, (confirmation(ONE, TWO, 0.55),))
    assert results.next_pairing() is None
    (advice,) = results.advice()
    assert (advice.nthread, advice.knee, advice.most_tried) == (2, 2, 4)
    assert advice.speedup == pytest.approx(1 / 0.55)
    assert advice.efficiency == pytest.approx(2.0 / 1.1 / 1.9)
    assert (advice.good_nbatch, advice.nbatch_tried) == ([64, 256], [4, 64, 256])
    assert advice.snippet == f"# rollout {TWO}"
    text = printed(results, code=True)
    assert "rollout (open loop): 2 threads, 1.82× one thread (1.75 to 1.89 in fresh" in text
    assert "96 % of the 1.90 cores that there were" in text
    assert "more threads than can run at once" in text
    assert "with 64, 256 simulations (tried: 4, 64, 256)" in text
    assert "# rollout" in text


def test_one_thread_is_advised_where_more_are_not_certainly_faster() -> None:
    results = ScalingResults(SEARCH, (confirmation(ONE, TWO, 0.97, error=0.05),))
    (advice,) = results.advice()
    assert (advice.nthread, advice.knee) == (1, 2)
    assert "one thread, because 2 threads seem faster, but not certainly" in printed(results)
    (unconfirmed,) = ScalingResults(SEARCH).advice()
    assert unconfirmed.nthread == 1
    assert "not compared again" in printed(ScalingResults(SEARCH))


def test_a_chunk_size_is_advised_where_it_is_certainly_faster() -> None:
    chunked = {**TWO, "chunk": 16}
    chunks = run(Stage.CHUNK, 64, (ONE, 1.1), (TWO, 2.0), (chunked, 2.2))
    results = ScalingResults((*SEARCH, chunks), (confirmation(ONE, TWO, 0.55),))
    pairing = results.next_pairing()
    assert pairing is not None
    assert (pairing.baseline.options, pairing.candidate.options) == (TWO, chunked)
    assert results.advice()[0].chunk is None
    for estimate, chunk in ((0.9, 16), (0.985, None)):
        again = confirmation(TWO, chunked, estimate, error=0.005)
        (advice,) = ScalingResults(
            (*SEARCH, chunks), (confirmation(ONE, TWO, 0.55), again)
        ).advice()
        assert advice.chunk == chunk


def test_where_no_number_of_threads_helps_one_is_advised() -> None:
    slow = run(Stage.THREADS, 64, (ONE, 1.1), (TWO, 0.9))
    results = ScalingResults((slow,))
    assert results.next_pairing() is None
    assert "rollout (open loop): one thread, as fast as any number up to 2" in printed(results)


def test_a_warning_says_that_cores_were_missing() -> None:
    busy = run(Stage.THREADS, 64, (ONE, 1.1), (TWO, 1.3))
    model = model_record(cores_had=[1.2], usable_cores=2, nbatch=64, nstep=10, nbatch_asked=64)
    record = ScalingRecord(
        stage=busy.stage, topology=TOPOLOGY, model=model, measurements=busy.measurements
    )
    assert "threads had 1.20 of 2 cores" in printed(ScalingResults((record,)))


def test_a_search_that_failed_says_why() -> None:
    record = ScalingRecord(
        stage=Stage.THREADS,
        topology=TOPOLOGY,
        model=model_record(status=Status.CRASHED, detail="it crashed", facts=None, work=None),
        measurements=[],
    )
    text = printed(ScalingResults((record,)))
    assert "it crashed" in text
    assert ScalingResults((record,)).advice() == []


def test_records_are_grouped_by_model() -> None:
    (results,) = by_model(SEARCH, [confirmation(ONE, TWO, 0.55)])
    assert results.records == SEARCH
    assert len(results.rows()) == 7
    assert by_model([], []) == []


def test_a_confirmation_that_failed_says_why() -> None:
    failed = dataclasses.replace(
        confirmation(ONE, TWO, 0.5), status=Status.FAILED, detail="it crashed", ratio=None
    )
    results = ScalingResults(SEARCH, (failed,))
    assert results.next_pairing() is None
    assert results.advice()[0].nthread == 1
    assert "not compared again in fresh processes: it crashed" in printed(results)


def test_a_number_of_simulations_that_is_slower_is_not_said_to_do() -> None:
    results = ScalingResults((*SEARCH, run(Stage.NBATCH, 1024, (ONE, 1.1), (TWO, 1.2))))
    assert results.advice()[0].good_nbatch == [64, 256]


def test_a_path_without_one_thread_has_no_advice() -> None:
    results = ScalingResults((run(Stage.THREADS, 64, (TWO, 2.0)),))
    assert results.advice() == []
    assert "no path was timed with one thread" in printed(results)
