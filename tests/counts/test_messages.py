"""Requests and answers in files: typed on both sides, and readable when cut short."""

from pathlib import Path

import numpy as np

from mjbench.counts import messages
from mjbench.counts.messages import CountedWork, CountRequest, ModelRequest, OperationRequest
from mjbench.errors import Failure
from mjbench.simulation.models import ModelSource
from mjbench.simulation.sampling import SampleRequest
from mjbench.simulation.work import Work
from mjbench.simulation.work_check import Followed
from mjbench.status import Status


def test_a_request_is_read_as_it_was_written(tmp_path: Path) -> None:
    source = ModelSource("pile", tmp_path / "pile.xml")
    model_request = ModelRequest(
        source, tmp_path / "0.pickle", SampleRequest(2, 50, hold=5, seed=1)
    )
    operation_request = OperationRequest("copy pile", source)
    request = CountRequest("4.0.0", (model_request, operation_request))
    messages.write_request(tmp_path / "request", request)
    assert messages.read_request(tmp_path / "request") == request


def test_a_program_killed_while_it_writes_loses_its_last_answer_alone(tmp_path: Path) -> None:
    file = tmp_path / "answers"
    run = {"qpos": np.arange(6.0).reshape(1, 2, 3)}
    healthy, followed = np.ones(2, dtype=bool), Followed([0], run, run)
    failure = Failure(Status.INPUT, "no joint")
    work = CountedWork(100, Work(1.0, 4.0, 2.0), 0, {}, healthy, followed)
    with file.open("wb") as stream:
        messages.append_answer(stream, failure)
        first_end = stream.tell()
        messages.append_answer(stream, work)
    content = file.read_bytes()
    broken, pile = messages.read_answers(file)
    assert broken == failure
    assert isinstance(pile, CountedWork)
    assert pile.work == work.work
    assert pile.followed is not None
    assert np.array_equal(pile.followed.run["qpos"], run["qpos"])
    for end in range(len(content)):
        file.write_bytes(content[:end])
        assert messages.read_answers(file) == ([failure] if end >= first_end else [])


def test_a_program_that_has_written_nothing_has_no_answers(tmp_path: Path) -> None:
    assert messages.read_answers(tmp_path / "answers") == []
