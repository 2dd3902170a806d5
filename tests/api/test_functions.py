"""Each function once, on a small model and with small limits."""

import ctypes
import inspect
from pathlib import Path
from typing import Any

import mujoco
import process_tree
import pytest

import mjbench
from mjbench.commands.profile import rendering
from mjbench.errors import InputError, MachineError
from mjbench.host import child
from mjbench.paired.metrics import Metric
from mjbench.simulation import models
from mjbench.status import Status


@pytest.fixture(autouse=True)
def _leaves_no_process_and_no_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    before = process_tree.descendants()
    monkeypatch.chdir(tmp_path)
    yield
    assert process_tree.descendants() <= before
    assert not list(tmp_path.iterdir())


def test_paths_are_compared(model: Any) -> None:
    shares: list[float] = []
    compared = mjbench.compare(
        model,
        "cartpole",
        paths="rollout",
        threads=1,
        nbatch=4,
        nstep=10,
        budget_s=0.1,
        on_progress=lambda name, share: shares.append(share),
    )
    assert [results.model.model for results in compared.models] == ["MuJoCo Model", "cartpole"]
    assert {result.status for result in compared.results} == {Status.OK}
    assert all(result.agrees for result in compared.results)
    assert {result.nbatch for result in compared.results} == {4}
    assert shares == sorted(shares)
    assert shares[-1] == 1.0
    assert "cartpole: 4 simulations × 10 steps" in str(compared)


def test_a_model_that_fails_costs_its_own_results(tmp_path_factory: Any) -> None:
    broken = tmp_path_factory.mktemp("models") / "broken.xml"
    broken.write_text("<mujoco><nothing/></mujoco>")
    compared = mjbench.compare(
        broken, "cartpole", paths="rollout", threads=1, nbatch=2, nstep=4, budget_s=0.1
    )
    failed, fine = (results.model for results in compared.models)
    assert (failed.status, fine.status) == (Status.INPUT, Status.OK)
    with pytest.raises(InputError, match=r"broken\.xml: MuJoCo cannot load it"):
        mjbench.compare(broken, budget_s=0.1)


def test_releases_are_compared() -> None:
    compared = mjbench.versions(
        "installed", "installed", models="cube_table", budget_s=0.1, as_shipped=True
    )
    (row,) = compared.verdicts
    assert (row.model, row.metric, row.status) == ("cube_table", Metric.TIME, Status.OK)
    assert row.work is not None
    assert compared.to_dict()["results"][0]["changed_work"] is False
    assert compared.family.count == 1


def test_a_step_is_profiled(model: Any, monkeypatch: pytest.MonkeyPatch, inline: None) -> None:
    monkeypatch.setattr(rendering, "BACKENDS", ())
    profiled = mjbench.profile(model, budget_s=0.05)
    assert profiled.steps.loop_ns > 0
    assert sum(profiled.stages.values()) == pytest.approx(1.0)
    assert profiled.row.steps == profiled.steps
    assert profiled.machine.usable_cores >= 1


def test_ticks_are_timed() -> None:
    timed = mjbench.latency("cartpole", nstep=300, rate_hz=2000, deadline_s=0.5)
    assert [row.ntick for row in timed.paces] == [300, 300]
    assert timed.paced.rate_hz == 2000
    assert timed.free_running.missed == 0
    assert "p99" in str(timed)


def test_states_of_the_program_are_the_starts(inline: None) -> None:
    cartpole = mujoco.MjModel.from_xml_path(str(models.resolve("cartpole").path))
    log = mjbench.record(cartpole, mujoco.MjData(cartpole), 50, ["time", "qpos", "qvel"])
    timed = mjbench.latency(cartpole, nstep=100, states=log)
    assert timed.free_running.ntick == 100


def installed_twice(**options: Any) -> object:
    return mjbench.versions("installed", "installed", models="cartpole", **options)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: mjbench.compare("cartpol"), "did you mean cartpole"),
        (lambda: mjbench.compare("cartpole", paths="rollot"), "did you mean rollout"),
        (lambda: mjbench.compare("cartpole", options={"tea": 1}), "NAME one of"),
        (lambda: mjbench.compare("cartpole", options={"pool": ["wet"]}), "pool is one of"),
        (lambda: mjbench.compare("cartpole", nstep=7, hold=2), "not a multiple"),
        (lambda: mjbench.compare("cartpole", paths="json:loads"), "json:loads"),
        (lambda: mjbench.versions("installed"), "name an old and a new release"),
        (lambda: mjbench.versions("installed", "tea"), "is not a release"),
        (lambda: mjbench.compare(), "name a model, one of cartpole, "),
        (lambda: mjbench.versions("installed", "installed"), "name a model, one of cartpole, "),
        (lambda: installed_twice(paths="mjx"), "in place of installed"),
        (lambda: installed_twice(paths="rollout", metric="memory"), "steps by python_loop only"),
        (lambda: mjbench.profile("missing.xml"), "no such file"),
        (lambda: mjbench.latency("cartpole", rate_hz=0), "rate_hz must be above 0"),
        (lambda: mjbench.latency("cartpole", states="missing.npz"), "no such file"),
        (lambda: mjbench.latency("cartpole", settle_s=0.5, states={"qpos": [[0.0]]}), "not both"),
    ],
)
def test_bad_input_is_refused_in_a_line(call: Any, message: str) -> None:
    with pytest.raises(InputError, match=message) as error:
        call()
    assert "\n" not in str(error.value)


def test_a_process_that_hangs_is_a_machine_error() -> None:
    with pytest.raises(MachineError, match="no answer within"):
        mjbench.profile("humanoid", time_limit_s=0.001)


def test_orphans_are_adopted_only_while_something_is_measured() -> None:
    library, flag = ctypes.CDLL(None), ctypes.c_int()
    library.prctl(36, 0)
    with child.adoption():
        child.Child(["true"]).end()
        library.prctl(37, ctypes.byref(flag))
        assert flag.value == 1
    library.prctl(37, ctypes.byref(flag))
    assert flag.value == 0


# What may be anything: it is true or false.
FLAGS = {"as_shipped", "quick", "rl", "same_moment", "wait"}


@pytest.mark.parametrize("function", mjbench.__all__)
def test_an_argument_of_a_wrong_type_is_bad_input(function: str, model: Any) -> None:
    usual = {
        "data": mujoco.MjData(model),
        "fields": ["qpos"],
        "file": "a.npz",
        "model": model,
        "nstep": 1,
        "old": "3.17.0",
        "target": "cartpole",
    }
    called = getattr(mjbench, function)
    parameters = inspect.signature(called).parameters.values()
    needed = [p for p in parameters if p.default is p.empty and p.kind != p.VAR_POSITIONAL]
    for wrong in [p for p in parameters if p.name not in FLAGS]:
        several = [object()] if wrong.kind == wrong.VAR_POSITIONAL else []
        given = {p.name: usual.get(p.name) for p in needed}
        values = [given.pop(p.name) for p in needed] if several else []
        named = {} if several else {wrong.name: object()}
        with pytest.raises(InputError):
            called(*values, *several, **given | named)
            pytest.fail(f"{function} takes anything as {wrong.name}")
