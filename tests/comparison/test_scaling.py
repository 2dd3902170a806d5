"""What a search for the number of threads measures, and finds, on invented machines."""

import dataclasses
from collections.abc import Callable, Sequence

import pytest
from example_records import measurement, model_record

from mjbench import paths
from mjbench.comparison import scaling, scaling_search
from mjbench.comparison.plan import ComparisonPlan
from mjbench.comparison.scaling import (
    ScalingRecord,
    ScalingRequest,
    ScalingRun,
    Stage,
    parallel_option,
)
from mjbench.errors import InputError
from mjbench.instrument.topology import Topology
from mjbench.paths.parallelism import nthread
from mjbench.status import Status

# Speed-up over the plain loop by threads, chunk size (None: the path's own) and simulations.
Speed = Callable[[int, int | None, int], float]
# The same noise in every round of every variant.
NOISE = (1.0, 1.01, 0.99, 1.02, 0.98, 1.0, 1.01, 0.99)


def request(
    topology: Topology, path_names: Sequence[str] = ("rollout",), **fields: object
) -> ScalingRequest:
    plan = ComparisonPlan(variants=())
    return ScalingRequest(plan, path_names, {}, topology, **fields)  # type: ignore[arg-type]


def record_of(run: ScalingRun, speed: Speed, cores: float) -> ScalingRecord:
    """Return the record of a run on a machine of this speed."""
    nbatch, nstep = run.plan.nbatch or 0, run.plan.nstep or 10
    sizes = {"nbatch": nbatch, "nbatch_asked": nbatch, "nstep": nstep}
    plain_s = 1e-6 * nbatch * nstep
    measurements = []
    for variant in run.plan.variants:
        factor = 1.0
        if variant.path != paths.BASE:
            factor = speed(nthread(variant.options), variant.options.get("chunk"), nbatch)
        samples = [plain_s * noise / factor for noise in NOISE]
        measurements.append(
            measurement(path=variant.path, options=variant.options, samples_s=samples, **sizes)
        )
    return ScalingRecord(
        stage=run.stage,
        topology=Topology(1),
        model=model_record(cores_had=[cores], **sizes),
        measurements=measurements,
    )


def searched(
    wanted: ScalingRequest, speed: Speed, cores: float = 2.0
) -> tuple[list[ScalingRun], list[ScalingRecord]]:
    """Return the runs of a search, and their records."""
    runs: list[ScalingRun] = []
    records: list[ScalingRecord] = []
    search = scaling_search.search(wanted)
    try:
        runs.append(next(search))
        while True:
            records.append(record_of(runs[-1], speed, cores))
            runs.append(search.send(records[-1]))
    except StopIteration:
        return runs, records


def counts(run: ScalingRun) -> list[int]:
    return [nthread(v.options) for v in run.plan.variants if v.path != paths.BASE]


def test_threads_are_tried_up_to_twice_as_many_as_can_run() -> None:
    runs, records = searched(request(Topology(2, 2)), lambda n, chunk, nbatch: min(n, 2))
    threads = [run for run in runs if run.stage == Stage.THREADS]
    assert counts(threads[0]) == [1, 2, 4]
    # between the best and the next; 2 once more, to compare with
    assert counts(threads[1]) == [1, 2, 3]
    points = [p for record in records for p in scaling.points(record)]
    assert scaling.knees(points) == {"rollout": 2}
    assert all(p.efficiency == pytest.approx(1.0) for p in points if p.over_one)


def test_many_cores_are_searched_and_not_gridded() -> None:
    topology = Topology(64, 32, (32, 32))
    runs, records = searched(request(topology), lambda n, chunk, nbatch: min(n, 24) ** 0.9, 32.0)
    threads = [run for run in runs if run.stage == Stage.THREADS]
    assert counts(threads[0]) == [1, 2, 4, 8, 16, 32, 64, 128]
    tried = {count for run in threads for count in counts(run)}
    assert len(tried) < 16
    points = [p for record in records for p in scaling.points(record)]
    # 95 % of the speed of 24 threads needs 23 of them
    assert 20 <= scaling.knees(points)["rollout"] <= 32


def test_a_number_of_simulations_suits_the_most_threads() -> None:
    assert request(Topology(64)).first_nbatch == 512
    assert request(Topology(2)).first_nbatch == 64
    assert request(Topology(64), nbatch=[8, 16]).first_nbatch == 16


def test_chunk_sizes_are_tried_with_the_threads_of_the_knee() -> None:
    def speed(n: int, chunk: int | None, nbatch: int) -> float:
        return min(n, 2) * (1.2 if chunk == 16 else 1.0)

    _, records = searched(request(Topology(2, 2)), speed)
    (chunks,) = [record for record in records if record.stage == Stage.CHUNK]
    points = scaling.points(chunks)
    assert [p.chunk for p in points if p.nthread == 2] == [None, 1, 4, 16, 32]
    best = max(points, key=lambda p: p.speedup.median)
    assert best.chunk == 16
    assert best.over_usual is not None
    assert best.over_usual.median == pytest.approx(1.2)


def test_simulations_are_tried_until_a_block_is_long() -> None:
    runs, _ = searched(request(Topology(2, 2)), lambda n, chunk, nbatch: min(n, 2))
    # a step of the plain loop takes a microsecond here, so the most is the limit
    assert [r.plan.nbatch for r in runs if r.stage == Stage.NBATCH] == [4, 16, 256, 1024, 4096]
    assert {r.plan.nstep for r in runs[1:]} == {10}
    assert all(counts(run) == [1, 2] for run in runs if run.stage == Stage.NBATCH)


def test_the_user_fixes_what_is_tried() -> None:
    wanted = request(Topology(2, 2), thread_counts=[3], chunk_sizes=[5], nbatch=[8, 24])
    runs, _ = searched(wanted, lambda n, chunk, nbatch: n)
    assert [run.stage for run in runs] == [Stage.THREADS, Stage.CHUNK, Stage.NBATCH]
    assert counts(runs[0]) == [1, 3]
    assert [v.options.get("chunk") for v in runs[1].plan.variants[1:]] == [None, None, 5]
    assert [run.plan.nbatch for run in runs] == [24, 24, 8]


def test_no_gain_means_one_thread_and_no_chunk_sizes() -> None:
    runs, records = searched(request(Topology(2, 2)), lambda n, chunk, nbatch: 1.0 / n)
    points = [p for record in records for p in scaling.points(record)]
    assert scaling.knees(points) == {"rollout": 1}
    assert Stage.CHUNK not in {run.stage for run in runs}


def test_efficiency_is_of_the_cores_that_there_were() -> None:
    _, records = searched(request(Topology(2, 2)), lambda n, chunk, nbatch: min(n, 1.5), 1.5)
    by_count = {p.nthread: p for p in scaling.points(records[0])}
    assert by_count[2].efficiency == pytest.approx(1.0)
    assert by_count[1].efficiency == pytest.approx(1.0)


def test_paths_with_threads_or_processes_can_be_searched_and_no_others() -> None:
    assert parallel_option("processes") == "processes"
    assert parallel_option("ray") == "actors"
    assert parallel_option("batch_step") == "threads"
    with pytest.raises(InputError, match="python_loop has no threads"):
        request(Topology(2), ["rollout", "python_loop"])


def test_a_search_ends_where_a_run_fails() -> None:
    search = scaling_search.search(request(Topology(2)))
    run = next(search)
    failed = ScalingRecord(
        stage=run.stage,
        topology=Topology(2),
        model=model_record(status=Status.CRASHED),
        measurements=[],
    )
    with pytest.raises(StopIteration):
        search.send(failed)


def test_a_record_is_known_by_its_run() -> None:
    runs, records = searched(request(Topology(2)), lambda n, chunk, nbatch: n)
    assert all(run.is_of(record, "m") for run, record in zip(runs, records, strict=True))
    assert not runs[0].is_of(records[1], "m")
    assert not runs[0].is_of(records[0], "other")


def test_a_search_without_one_thread_ends() -> None:
    search = scaling_search.search(request(Topology(2)))
    record = record_of(next(search), lambda n, chunk, nbatch: n, 2.0)
    timed = [m for m in record.measurements if m.path == paths.BASE or nthread(m.options) > 1]
    with pytest.raises(StopIteration):
        search.send(dataclasses.replace(record, measurements=timed))


def test_a_quota_limits_what_is_tried() -> None:
    wanted = request(Topology(128, 64, (64, 64), 2.0))
    assert (wanted.first_counts, wanted.first_nbatch) == ([1, 2, 4], 64)
