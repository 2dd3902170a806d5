"""Every path in lock step with the reference run, over small models."""

from collections.abc import Iterator
from typing import Any

import mujoco
import numpy as np
import pytest
from example_models import CONTACT_XML

from mjbench import paths
from mjbench.errors import InputError
from mjbench.paths.accelerated import AcceleratedPath
from mjbench.paths.threads import shares
from mjbench.simulation import agreement, compat, work, workload

SWEEP: dict[str, list[Any]] = {
    "threads": [1, 2],
    "processes": [2],
    "chunk": [None, 2],
    "record": ["none", "qpos", "state"],
    "checks": ["on", "off"],
    "returns": ["states", "nothing"],
    "stage": ["none", "vel"],
    "data": ["shared", "persistent"],
    "engine_threads": [None, 2],
}
# those that compile are held to tolerances, in processes of their own: test_accelerated.py
C_PATHS = {n: p for n, p in paths.registry().items() if not isinstance(p, AcceleratedPath)}
VARIANTS = [
    pytest.param(path, options, id=" ".join([name, *(f"{k}={v}" for k, v in options.items())]))
    for name, path in C_PATHS.items()
    for options in path.variants(SWEEP)
]


@pytest.fixture(scope="module")
def work_and_truth() -> Iterator[tuple[workload.Workload, work.Observation, paths.Resources]]:
    made = workload.make(mujoco.MjModel.from_xml_string(CONTACT_XML), 7, 12, hold=3, seed=2)
    resources = paths.Resources(made)
    yield made, work.observe(made), resources
    resources.close()


def difference(states: paths.States, truth: work.Observation, model: Any) -> Any:
    columns = compat.state_columns(model, compat.state_spec("INTEGRATION"))
    return agreement.first_difference(states.values, truth.final_state, columns, states.held)


@pytest.mark.parametrize(("path", "options"), VARIANTS)
def test_it_reaches_the_reference_states_to_the_last_bit(
    work_and_truth: Any, path: paths.SteppingPath, options: dict[str, Any]
) -> None:
    made, truth, resources = work_and_truth
    reason = path.unavailable() or path.unsuited(made, options)
    if reason:
        pytest.skip(reason)
    prepared = path.prepare(made, options, resources)
    whole = prepared.verify()
    assert whole.held is None
    assert difference(whole, truth, made.model) is None
    for _ in range(2):  # a timed block leaves nothing behind that changes the next
        prepared.clear()
        prepared.run()
        assert difference(prepared.final_states(), truth, made.model) is None


@pytest.mark.parametrize(("path", "options"), VARIANTS)
def test_a_block_that_does_not_run_cannot_pass(
    work_and_truth: Any, path: paths.SteppingPath, options: dict[str, Any]
) -> None:
    made, truth, resources = work_and_truth
    reason = path.unavailable() or path.unsuited(made, options)
    if reason:
        pytest.skip(reason)
    prepared = path.prepare(made, options, resources)
    prepared.run()
    prepared.clear()
    assert difference(prepared.final_states(), truth, made.model) is not None


@pytest.mark.parametrize(
    ("path", "options"),
    [v for v in VARIANTS if v.values[0].name != "processes"],  # type: ignore[attr-defined]
)
def test_its_snippet_does_what_it_does(
    work_and_truth: Any, path: paths.SteppingPath, options: dict[str, Any]
) -> None:
    made, truth, _ = work_and_truth
    reason = path.unavailable() or path.unsuited(made, options)
    if reason:
        pytest.skip(reason)
    names = {
        "model": made.model,
        "initial_state": made.initial_state.copy(),
        "control": made.control.copy(),
    }
    exec(compile(path.snippet(made, options), path.name, "exec"), names)
    expected = truth.final_state
    if path.name == "rollout":  # it returns full-physics states
        whole = compat.state_columns(made.model, compat.state_spec("INTEGRATION"))
        physics = compat.state_columns(made.model, compat.state_spec("FULLPHYSICS"))
        expected = expected[:, np.concatenate([np.r_[whole[field]] for field in physics])]
    np.testing.assert_array_equal(names["final_state"], expected)


def test_the_processes_snippet_does_what_it_does(work_and_truth: Any, tmp_path: Any) -> None:
    import subprocess
    import sys

    made, truth, _ = work_and_truth
    mujoco.mj_saveModel(made.model, str(tmp_path / "model.mjb"))
    np.savez(tmp_path / "given.npz", initial_state=made.initial_state, control=made.control)
    code = paths.find("processes").snippet(made, {"processes": 2})
    head = (
        "import mujoco, numpy as np\n"
        "model = mujoco.MjModel.from_binary_path('model.mjb')\n"
        "given = np.load('given.npz')\n"
        "initial_state, control = given['initial_state'], given['control']\n"
    )
    tail = "    np.save('final.npy', final_state)\n"
    (tmp_path / "program.py").write_text(head + code + tail)
    subprocess.run([sys.executable, "program.py"], cwd=tmp_path, check=True, timeout=120)
    np.testing.assert_array_equal(np.load(tmp_path / "final.npy"), truth.final_state)


def test_models_without_actuators_run_on_every_path() -> None:
    xml = (
        "<mujoco><worldbody><geom type='plane' size='1 1 1'/><body pos='0 0 .099'><freejoint/>"
        "<geom type='box' size='.1 .1 .1'/></body></worldbody></mujoco>"
    )
    made = workload.make(mujoco.MjModel.from_xml_string(xml), 3, 6)
    truth, resources = work.observe(made), paths.Resources(made)
    for path in C_PATHS.values():
        if path.unavailable():
            continue
        options = path.variants({"threads": [2], "processes": [2]})[0]
        states = path.prepare(made, options, resources).verify()
        assert difference(states, truth, made.model) is None, path.name
    resources.close()


def test_variants_drop_options_that_mean_nothing_at_one_thread() -> None:
    variants = paths.find("rollout").variants({"threads": [1, 2], "chunk": [1, 8]})
    assert variants[0] == {"threads": 1}
    assert {"threads": 2, "chunk": 8, "pool": "new"} in variants
    assert len(variants) == 1 + 4


def test_by_default_only_the_most_threads_get_an_mjdata_per_simulation() -> None:
    variants = paths.find("batch_step").variants({"threads": [1, 2, 4]})
    assert [v["threads"] for v in variants if v["data"] == "persistent"] == [4]


def test_paths_share_their_mjdata_and_outputs(small: workload.Workload) -> None:
    resources = paths.Resources(small)
    assert resources.datas(2)[0] is resources.datas(1)[0]
    assert resources.final_state() is resources.final_state()
    resources.close()


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("rolout", "did you mean rollout"),
        ("no_such_module:Path", "No module named"),
        ("math:pi", "not a subclass"),
    ],
)
def test_a_wrong_path_name_is_told(name: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        paths.find(name)


def test_shares_cover_everything_once() -> None:
    for count, workers, size in [(7, 2, None), (7, 3, None), (8, 2, 3), (1, 4, None)]:
        parts = shares(count, workers, size)
        assert [i for part in parts for i in range(count)[part]] == list(range(count))
        assert size or len(parts) <= workers
