"""MJX and Warp in processes of their own: the same workload, judged, killed where they hang."""

import dataclasses
from pathlib import Path
from typing import Any

import pytest
from commands import TESTS
from example_models import PENDULUM_XML
from pretender import MODEL, available, make_workload

from mjbench.commands.compare import accelerated_measurement
from mjbench.commands.compare.accelerated_measurement import AcceleratedRequest
from mjbench.commands.compare.driver import ComparedModel
from mjbench.host.child_connection import ChildConnection
from mjbench.paired.worker_pool import WorkerPool
from mjbench.paths.accelerated import AcceleratedPath, save_workload
from mjbench.session import Observer
from mjbench.simulation import models
from mjbench.simulation.accelerated_judgement import EngineAnswer, PartName
from mjbench.simulation.reference_run import observe
from mjbench.simulation.workload import Workload
from mjbench.status import Status
from mjbench.verification.plan import ComparisonPlan, Variant
from mjbench.verification.records import VariantRecord


def measured(
    path: AcceleratedPath, workload: Workload, folder: Path, model: str = MODEL, **more: Any
) -> VariantRecord:
    """Return the record of a path that agrees and was timed."""
    file = folder / "workload.pickle"
    save_workload(workload, observe(workload).peaks, file)
    request = AcceleratedRequest(models.resolve(model), Variant(path.name, {}), file)
    records: list[VariantRecord] = []
    ended = accelerated_measurement.run(
        dataclasses.replace(request, **more), records.append, str(TESTS)
    )
    assert ended.status == Status.OK, ended.detail
    assert records[-1].agrees is True, records[-1].detail
    assert len(records[-1].samples_s) >= accelerated_measurement.MIN_BLOCKS
    return records[-1]


@pytest.mark.parametrize(
    ("engine", "model", "package"),
    [("FixedMjx", "pendulum.xml", "mujoco-mjx"), ("QuickWarp", MODEL, "mujoco-warp")],
)
def test_what_moves_without_contact_keeps_to_the_tolerances(
    engine: str,
    model: str,
    package: str,
    tmp_path: Path,
    request: pytest.FixtureRequest,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    if engine == "FixedMjx":  # `mjx_warp` runs as where Warp is installed
        request.getfixturevalue("without_warp")
    monkeypatch.chdir(tmp_path)
    Path("pendulum.xml").write_text(PENDULUM_XML)
    workload = make_workload(model)
    record = measured(available(f"quick_engines:{engine}"), workload, tmp_path, model)
    assert record.compile_s is not None
    assert record.compile_s > 0
    assert record.device
    assert record.memory_bytes is not None
    assert record.memory_bytes > 2**20
    assert record.versions is not None
    assert package in record.versions
    assert (record.cached_compile_s is not None) == (engine == "FixedMjx")
    judgement = record.judgement
    assert judgement is not None
    assert judgement.answer == EngineAnswer.YES
    assert {PartName.INPUTS, PartName.SMOOTH, PartName.RUN} <= {p.name for p in judgement.parts}


BALL = """
<mujoco>
  <worldbody>
    <geom type="plane" size="1 1 1"/>
    <body pos="0 0 0.099"><freejoint/><geom type="sphere" size="0.1"/></body>
  </worldbody>
</mujoco>
"""


def test_warp_called_by_mjx_has_room_and_reports_its_contacts(tmp_path: Path) -> None:
    (tmp_path / "ball.xml").write_text(BALL)
    model = str(tmp_path / "ball.xml")
    workload = make_workload(model, nbatch=8, nstep=10)
    assert observe(workload).peaks.contacts == 1
    path = available("quick_engines:QuickMjxWarp")
    record = measured(path, workload, tmp_path, model=model, limit_s=120.0)
    judgement = record.judgement
    assert judgement is not None
    assert judgement.contact_states > 0
    (pair,) = judgement.pairs
    assert (pair.types, pair.other_counts) == (("plane", "sphere"), 0)
    assert pair.normal_degrees is not None
    assert pair.normal_degrees < 1e-3
    # 48 contacts of each world; twice the 4 constraints of the cone
    assert "naconmax=384, njmax=8" in record.snippet


def test_a_program_that_never_returns_is_a_row_that_says_timeout(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The run goes on: the paths before and after it have their speeds.

    What it timed before, after a block that warms up, has arrived as it came. Only the child that
    hangs has a short limit, from its last block on: a busy machine ends no other.
    """
    (tmp_path / "hangs.py").write_text(
        "import dataclasses, os, pathlib, threading\n"
        "from pretender import Pretender\n"
        "class Hangs(Pretender):\n"
        "    name = 'hangs'\n"
        "    def compile(self, workload, options, peaks):\n"
        "        compiled, ran = super().compile(workload, options, peaks), []\n"
        "        def run():\n"
        "            ran.append(compiled.run())\n"
        "            if len(ran) == 4:\n"
        f"                pathlib.Path({str(tmp_path)!r}, str(os.getpid())).touch()\n"
        "            if len(ran) == 5: threading.Event().wait()\n"
        "        return dataclasses.replace(compiled, run=run)\n"
        "class Fine(Pretender):\n"
        "    name = 'fine'\n"
    )
    receive = ChildConnection.receive

    def receive_from(own: ChildConnection, limit_s: float, *more: Any, **named: Any) -> bytes:
        is_last = (tmp_path / str(own.process.pid)).exists()
        return receive(own, 2.0 if is_last else limit_s, *more, **named)

    monkeypatch.setattr(ChildConnection, "receive", receive_from)
    names = ("python_loop", "hangs:Hangs", "hangs:Fine")
    plan = ComparisonPlan(
        variants=tuple(Variant(name, {}) for name in names),
        nbatch=2,
        nstep=4,
        budget_s=0.1,
        import_from=str(tmp_path),
        named=names,
    )
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parents[2]))
    with WorkerPool() as pool:
        source = models.resolve(MODEL)
        compared = ComparedModel(pool, source, plan, (0.0, 1.0), (), Observer())
        compared.run()
    last = compared.known()
    rows = {result.path: result for result in last.results}
    assert rows["hangs:Hangs"].status == Status.TIMEOUT
    assert "timing hangs" in rows["hangs:Hangs"].detail
    assert rows["hangs:Hangs"].step_ns is None
    assert len(last.measurements[1].samples_s) == 3
    assert rows["python_loop"].step_ns
    assert rows["hangs:Fine"].step_ns


def test_a_path_that_does_not_compile_is_refused(tmp_path: Path) -> None:
    from mjbench.errors import InputError

    with pytest.raises(InputError, match="does not compile"):
        variant = Variant("rollout", {})
        request = AcceleratedRequest(models.resolve(MODEL), variant, tmp_path / "none")
        accelerated_measurement.run(request, lambda record: None)


def test_a_buffer_that_overflows_in_timed_blocks_is_a_fault(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "overflows.py").write_text(
        "import dataclasses\n"
        "from pretender import Pretender\n"
        "from mjbench.paths.warp_buffers import OverflowedError\n"
        "def overflow():\n"
        "    raise OverflowedError('naconmax is too small')\n"
        "class Overflows(Pretender):\n"
        "    name = 'overflows:Overflows'\n"
        "    def compile(self, workload, options, peaks):\n"
        "        compiled = super().compile(workload, options, peaks)\n"
        "        return dataclasses.replace(compiled, final_states=overflow)\n"
    )
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parents[2]))
    workload, file = make_workload(), tmp_path / "workload.pickle"
    save_workload(workload, observe(workload).peaks, file)
    variant = Variant("overflows:Overflows", {})
    request = AcceleratedRequest(models.resolve(MODEL), variant, file)
    records: list[VariantRecord] = []
    ended = accelerated_measurement.run(request, records.append, str(tmp_path))
    assert ended.status == Status.OK, ended.detail
    assert (records[-1].status, records[-1].agrees) == (Status.DISAGREES, False)
    assert "naconmax is too small" in records[-1].detail
    assert not records[-1].samples_s
