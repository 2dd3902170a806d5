"""Every C path against the reference run, over small models."""

import subprocess
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from example_models import CONTACT_XML

from mjbench import paths
from mjbench.errors import InputError
from mjbench.paths.base import nthread
from mjbench.paths.threads import shares
from mjbench.simulation import agreement, compat, reference_run, workload
from mjbench.simulation.workload import Product, StepOutputs

SWEEP: dict[str, list[Any]] = {
    "threads": [1, 2],
    "processes": [2],
    "chunk": [None, 2],
    "checks": ["on", "off"],
    "stage": ["none", "vel"],
    "data": ["shared", "persistent"],
    "engine_threads": [None, 2],
}
# paths that compile are held to tolerances: tests/commands/compare/test_accelerated_measurement.py
C_PATHS = {name: path for name, path in paths.registry().items() if not path.compiles}
VARIANTS = [
    pytest.param(path, options, id=" ".join([name, *(f"{k}={v}" for k, v in options.items())]))
    for name, path in C_PATHS.items()
    for options in path.variants(SWEEP)
]


# snippets that run as a program: their processes import it, or what it defines
ELSEWHERE = ("processes",)


@dataclass(frozen=True)
class Case:
    """A workload, its reference run, and what its paths share."""

    workload: workload.Workload
    reference: reference_run.Observation
    outputs: StepOutputs
    resources: paths.Resources

    @classmethod
    def of(cls, own: workload.Workload) -> "Case":
        return cls(
            own, reference_run.observe(own), reference_run.step_outputs(own), paths.Resources(own)
        )

    def reorder(self, order: np.ndarray) -> None:
        self.resources.reorder(order)
        final_state = self.reference.final_state
        final_state[...] = final_state[order]
        self.outputs.reorder(order)

    def difference(self, states: paths.States) -> agreement.Difference | None:
        columns = compat.state_columns(self.workload.model)
        return agreement.first_differing_entry(
            states.values, self.reference.final_state, columns, states.mask
        )

    def skip_unless_possible(self, path: paths.SteppingPath, options: dict[str, Any]) -> None:
        if reason := path.cannot_run(self.workload, options):
            pytest.skip(reason)


@pytest.fixture(scope="module")
def case() -> Iterator[Case]:
    model = mujoco.MjModel.from_xml_string(CONTACT_XML)
    case = Case.of(workload.make(model, 7, 12, hold=3, seed=2))
    yield case
    case.resources.close()


def names_after_snippet(
    case: Case, path: paths.SteppingPath, options: dict[str, Any]
) -> dict[str, Any]:
    """Return the names that a path's snippet leaves, after it ran on copies of a case's arrays."""
    names = {
        "model": case.workload.model,
        "initial_state": case.workload.initial_state.copy(),
        "control": case.workload.control.copy(),
    }
    exec(compile(path.snippet(case.workload, options), path.name, "exec"), names)
    return names


@pytest.fixture(scope="module")
def cases() -> Iterator[Mapping[Product, Case]]:
    """Return a case for each product, of one step per control."""
    model = mujoco.MjModel.from_xml_string(CONTACT_XML)
    own = workload.make(model, 7, 6, seed=2)
    cases = {product: Case.of(own.returning(product)) for product in Product}
    yield cases
    for case in cases.values():
        case.resources.close()


@pytest.mark.parametrize(("path", "options"), VARIANTS)
def test_a_path_reaches_the_reference_states_to_the_last_bit(
    case: Case, path: paths.SteppingPath, options: dict[str, Any]
) -> None:
    case.skip_unless_possible(path, options)
    prepared = path.prepare(case.workload, options, case.resources)
    verified = prepared.verified_states()
    assert verified.mask is None
    assert case.difference(verified) is None
    for _ in range(2):  # a timed block does not change the result of the next
        prepared.clear()
        prepared.run()
        assert case.difference(prepared.final_states()) is None


@pytest.mark.parametrize("product", [Product.TRAJECTORY, Product.SENSORS])
@pytest.mark.parametrize(("path", "options"), VARIANTS)
def test_a_path_returns_every_step_to_the_last_bit_in_any_order_of_simulations(
    cases: Mapping[Product, Case],
    path: paths.SteppingPath,
    options: dict[str, Any],
    product: Product,
) -> None:
    case = cases[product]
    case.skip_unless_possible(path, options)
    prepared = path.prepare(case.workload, options, case.resources)
    for order in (np.arange(7), np.array([3, 0, 6, 1, 2, 5, 4])):
        case.reorder(order)
        prepared.clear()
        prepared.run()
        assert case.difference(prepared.final_states()) is None
        expected, returned = case.outputs, prepared.step_outputs()
        assert len(returned.arrays) == len(expected.arrays)
        for values, want in zip(returned.arrays, expected.arrays, strict=True):
            np.testing.assert_array_equal(values, want)


@pytest.mark.parametrize("product", [Product.TRAJECTORY, Product.SENSORS])
@pytest.mark.parametrize(
    ("path", "options"),
    [v for v in VARIANTS if v.values[0].name not in ELSEWHERE],  # type: ignore[attr-defined]
)
def test_a_snippet_returns_what_its_path_does(
    cases: Mapping[Product, Case],
    path: paths.SteppingPath,
    options: dict[str, Any],
    product: Product,
) -> None:
    case = cases[product]
    case.skip_unless_possible(path, options)
    names = names_after_snippet(case, path, options)
    np.testing.assert_array_equal(names["state"], case.outputs.state)
    if product == Product.SENSORS:
        np.testing.assert_array_equal(names["sensordata"], case.outputs.sensordata)


@pytest.mark.parametrize(("path", "options"), VARIANTS)
def test_a_block_that_does_not_run_cannot_pass(
    case: Case, path: paths.SteppingPath, options: dict[str, Any]
) -> None:
    case.skip_unless_possible(path, options)
    prepared = path.prepare(case.workload, options, case.resources)
    prepared.run()
    prepared.clear()
    assert case.difference(prepared.final_states()) is not None


@pytest.mark.parametrize(
    ("path", "options"),
    [v for v in VARIANTS if v.values[0].name not in ELSEWHERE],  # type: ignore[attr-defined]
)
def test_a_snippet_does_what_its_path_does(
    case: Case, path: paths.SteppingPath, options: dict[str, Any]
) -> None:
    case.skip_unless_possible(path, options)
    model = case.workload.model
    names = names_after_snippet(case, path, options)
    expected = case.reference.final_state
    if path.name == "rollout":  # it returns full-physics states
        columns = compat.state_columns(model)
        physics = compat.state_columns(model, compat.FULLPHYSICS)
        expected = expected[:, np.concatenate([np.r_[columns[field]] for field in physics])]
    np.testing.assert_array_equal(names["final_state"], expected)


@pytest.mark.parametrize("product", list(Product))
def test_a_snippet_that_starts_processes_does_what_its_path_does(
    case: Case, cases: Mapping[Product, Case], product: Product, tmp_path: Path
) -> None:
    case = case if product == Product.FINAL else cases[product]
    options = {"processes": 2}
    case.skip_unless_possible(paths.find("processes"), options)
    run_program(program_of(case, "processes", options, tmp_path), tmp_path)
    assert_does_the_work_of(case, tmp_path)


def expected_outputs(case: Case) -> dict[str, np.ndarray]:
    """Return what a snippet leaves, by the names of its variables."""
    expected = {"final_state": case.reference.final_state}
    product = case.workload.returns
    if product != Product.FINAL:
        expected["state"] = case.outputs.state
    if product == Product.SENSORS:
        expected["sensordata"] = case.outputs.sensordata
    return expected


def program_of(case: Case, name: str, options: dict[str, Any], folder: Path) -> str:
    """Return a program that runs a snippet on the input in a folder, and leaves its output there.

    The input is written here.
    """
    mujoco.mj_saveModel(case.workload.model, str(folder / "model.mjb"))
    np.savez(
        folder / "input.npz",
        initial_state=case.workload.initial_state,
        control=case.workload.control,
    )
    code = paths.find(name).snippet(case.workload, options)
    indent = "    " if "__main__" in code else ""
    head = (
        "import mujoco, numpy as np\n"
        f"model = mujoco.MjModel.from_binary_path('{folder}/model.mjb')\n"
        f"arrays = np.load('{folder}/input.npz')\n"
        "initial_state, control = arrays['initial_state'], arrays['control']\n"
    )
    outputs = ", ".join(f"{name}={name}" for name in expected_outputs(case))
    return f"{head}{code}{indent}np.savez('{folder}/output.npz', {outputs})\n"


def run_program(program: str, folder: Path) -> None:
    (folder / "program.py").write_text(program)
    subprocess.run([sys.executable, "program.py"], cwd=folder, check=True, timeout=120)


def assert_does_the_work_of(case: Case, folder: Path) -> None:
    """Compare the output in a folder with a case's reference."""
    expected = expected_outputs(case)
    with np.load(folder / "output.npz") as output:
        if output["final_state"].shape != expected["final_state"].shape:  # full-physics states
            physics = compat.physics_entries(case.workload.model)
            expected["final_state"] = expected["final_state"][:, physics]
        for field, values in expected.items():
            np.testing.assert_array_equal(output[field], values)


def test_a_model_without_actuators_runs_on_every_path() -> None:
    xml = (
        "<mujoco><worldbody><geom type='plane' size='1 1 1'/><body pos='0 0 .099'><freejoint/>"
        "<geom type='box' size='.1 .1 .1'/></body></worldbody></mujoco>"
    )
    case = Case.of(workload.make(mujoco.MjModel.from_xml_string(xml), 3, 6))
    for path in C_PATHS.values():
        if path.unavailable():
            continue
        options = path.variants({"threads": [2], "processes": [2]})[0]
        states = path.prepare(case.workload, options, case.resources).verified_states()
        assert case.difference(states) is None, path.name
    case.resources.close()


def test_one_thread_drops_the_options_that_have_no_effect() -> None:
    variants = paths.find("rollout").variants({"threads": [1, 2], "chunk": [1, 8]})
    assert variants[0] == {"threads": 1}
    assert {"threads": 2, "chunk": 8, "pool": "new"} in variants
    assert len(variants) == 1 + 4


def test_by_default_only_the_most_threads_get_an_mjdata_per_simulation() -> None:
    variants = paths.find("batch_step").variants({"threads": [1, 2, 4]})
    assert [v["threads"] for v in variants if v["data"] == "persistent"] == [4]


def test_a_full_option_set_has_one_thread_unless_it_says_otherwise() -> None:
    assert paths.find("threads").complete({}) == {"threads": 1}
    assert paths.find("processes").complete({"processes": 2}) == {"processes": 2}
    assert paths.find("python_loop_hold").complete({}) == {}
    assert paths.find("rollout").complete({"threads": 2}) == {"threads": 2, "pool": "kept"}


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ({}, 1),
        ({"threads": 3, "chunk": 8}, 3),
        ({"processes": 2}, 2),
        ({"engine_threads": 4}, 4),
        ({"engine_threads": None}, 1),
    ],
)
def test_the_number_of_threads_follows_from_the_options(
    options: dict[str, Any], expected: int
) -> None:
    assert nthread(options) == expected


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
def test_an_unknown_path_is_an_error_that_suggests_another(name: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        paths.find(name)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("NameIsNoText", "its name must be a str, not 7"),
        ("OptionsAreNoOptions", "must be of mjbench.paths.Option, not 'threads'"),
        ("CompilesWithoutInterface", "compiles must be True for a subclass of"),
        ("AttributeRaises", "RuntimeError: no summary"),
        ("ConstructorExits", "SystemExit: 5"),
    ],
)
def test_a_path_of_the_users_own_that_is_not_whole_is_bad_input(name: str, message: str) -> None:
    with pytest.raises(InputError) as caught:
        paths.find(f"wrong_paths:{name}")
    assert message in str(caught.value)
    assert str(caught.value).startswith(f"path wrong_paths:{name}: ")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("code", "message"),
    [
        ("def broken(:\n", "SyntaxError: invalid syntax"),
        ("1 / 0\n", "ZeroDivisionError"),
        ("import sys; sys.exit(3)\n", "SystemExit: 3"),
        ("class E(BaseException): pass\nraise E('two\\nlines')\n", "E: two lines"),
        ("import no_such_module\n", "No module named 'no_such_module'"),
    ],
)
def test_a_module_that_cannot_be_imported_is_bad_input(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, code: str, message: str
) -> None:
    name = f"broken_{tmp_path.name}"
    (tmp_path / f"{name}.py").write_text(code)
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(InputError) as caught:
        paths.find(f"{name}:MyPath")
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_importing_a_users_own_path_leaves_output_and_folder_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    code = "import os\nfrom wrong_paths import Right\nprint('welcome')\nos.chdir('/')\n"
    name = f"untidy_{tmp_path.name}"
    (tmp_path / f"{name}.py").write_text(code)
    monkeypatch.syspath_prepend(tmp_path)
    folder = Path.cwd()
    assert paths.find(f"{name}:Right").name == "wrong_paths:Right"
    assert Path.cwd() == folder
    assert capsys.readouterr().out == ""


def test_shares_cover_everything_once() -> None:
    for count, workers, size in [(7, 2, None), (7, 3, None), (8, 2, 3), (1, 4, None)]:
        parts = shares(count, workers, size)
        assert [i for part in parts for i in range(count)[part]] == list(range(count))
        assert size or len(parts) <= workers
