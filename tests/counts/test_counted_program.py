"""The program that Callgrind counts, run here without Callgrind."""

import os
import pickle
from multiprocessing import Pipe
from pathlib import Path

import mujoco
import pytest

from mjbench.counts import counted_program
from mjbench.counts.counted_program import (
    CountAnswer,
    CountedWork,
    Instrumentation,
    ModelRequest,
    OperationRequest,
    TaskRequest,
)
from mjbench.errors import Failure
from mjbench.paired import operations
from mjbench.releases import release_names
from mjbench.simulation import models, workload
from mjbench.simulation.models import ModelSource
from mjbench.simulation.workload_sampling import SampleRequest
from mjbench.status import Status

INSTALLED = release_names.parse_release(release_names.INSTALLED)


@pytest.fixture
def marked(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Return a list that gets an entry at each call of the marker."""
    calls: list[str] = []
    monkeypatch.setattr(mujoco, counted_program.MARKER, lambda: calls.append("marker"))
    return calls


def run(*requests: TaskRequest, version: str = INSTALLED.version) -> list[CountAnswer]:
    ours, theirs = Pipe()
    with ours, theirs:
        ours.send((version, requests))
        counted_program.main(os.dup(theirs.fileno()))
        return [ours.recv() for _ in requests]


def request_for(model_file: str, workload_file: Path, seed: int = 0) -> ModelRequest:
    source = ModelSource("contact", Path(model_file))
    return ModelRequest(source, workload_file, SampleRequest(2, 6, hold=3, seed=seed))


def test_an_answer_says_what_work_was_done(
    contact_file: str, tmp_path: Path, marked: list[str]
) -> None:
    (answer,) = run(request_for(contact_file, tmp_path / "0.pickle"))
    assert isinstance(answer, CountedWork)
    assert answer.steps == 12
    assert answer.diverged == 0
    assert answer.work.contacts > 0
    assert answer.followed.stepped["qpos"].shape[1] == 2
    assert answer.starts is not None
    assert len(marked) == counted_program.MARKERS


@pytest.mark.parametrize("model", ["contact", "broken"])
def test_only_work_and_markers_run_with_instrumentation(
    contact_file: str,
    tmp_path: Path,
    marked: list[str],
    monkeypatch: pytest.MonkeyPatch,
    model: str,
) -> None:
    for name in ("start", "stop"):
        monkeypatch.setattr(Instrumentation, name, lambda _, name=name: marked.append(name))
    broken = tmp_path / "broken.xml"
    broken.write_text("<mujoco><worldbody/></mujoco>")
    model_file = contact_file if model == "contact" else str(broken)
    run(request_for(model_file, tmp_path / "0.pickle"))
    assert marked == ["start", *["marker"] * counted_program.MARKERS, "stop"]


def test_asking_for_instrumentation_outside_callgrind_does_nothing() -> None:
    instrumentation = Instrumentation()
    assert instrumentation.start() is None
    assert instrumentation.stop() is None


def test_a_workload_without_a_probe_is_counted_all_the_same(
    small: workload.Workload, contact_file: str, tmp_path: Path, marked: list[str]
) -> None:
    file = tmp_path / "0.pickle"
    file.write_bytes(pickle.dumps(workload.portable(small)))
    (answer,) = run(request_for(contact_file, file))
    assert isinstance(answer, CountedWork)
    assert answer.steps == small.steps
    assert answer.followed is None


def test_the_second_release_does_the_work_that_the_first_one_drew(
    contact_file: str, tmp_path: Path, marked: list[str]
) -> None:
    file = tmp_path / "0.pickle"
    (first,) = run(request_for(contact_file, file))
    workload = file.read_bytes()
    (second,) = run(request_for(contact_file, file, seed=7))
    assert file.read_bytes() == workload
    assert isinstance(second, CountedWork)
    assert second.starts is None  # only the first knows
    assert isinstance(first, CountedWork)
    assert isinstance(second, CountedWork)
    stepped, again = (o.followed.stepped["qpos"] for o in (first, second))
    assert stepped.tolist() == again.tolist()


def test_a_broken_model_leaves_the_numbers_of_later_dumps_as_they_are(
    contact_file: str, tmp_path: Path, marked: list[str]
) -> None:
    broken_file = tmp_path / "broken.xml"
    broken_file.write_text("<mujoco><worldbody/></mujoco>")
    broken, whole = run(
        request_for(str(broken_file), tmp_path / "0.pickle"),
        request_for(contact_file, tmp_path / "1.pickle"),
    )
    assert isinstance(broken, Failure)
    assert broken.status is Status.INPUT
    assert isinstance(whole, CountedWork)
    assert len(marked) == 2 * counted_program.MARKERS


def test_an_operation_is_repeated_as_often_as_it_is_timed(
    tmp_path: Path, marked: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(mujoco, "mj_resetData", lambda model, data: marked.append("reset"))
    request = OperationRequest("reset", models.resolve("cartpole"), operations.reset, 3)
    assert run(request) == [None]
    block = ["reset"] * 3
    expected = block * counted_program.WARM_UPS + [*block, "marker"] * counted_program.MARKERS
    assert marked == expected


def test_an_operation_that_a_release_cannot_do_is_unavailable(
    tmp_path: Path, marked: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(operations.compat, "spec_unavailable", lambda: "it has no MjSpec")
    request = OperationRequest("spec", ModelSource("", Path()), operations.edit_spec, 1)
    assert run(request) == [Failure(Status.UNAVAILABLE, "it has no MjSpec")]
    assert len(marked) == counted_program.MARKERS


def test_another_release_than_the_one_asked_for_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SystemExit, match=r"2\.3\.7"):
        run(version="2.3.7")
