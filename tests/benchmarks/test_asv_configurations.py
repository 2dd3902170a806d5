"""The configurations of asv: the user's results lie apart from the committed ones."""

from pathlib import Path
from typing import Any

from asv import util
from commands import ROOT

FOLDERS = ("repo", "benchmark_dir", "env_dir", "results_dir", "html_dir")


def configuration(file: Path) -> tuple[dict[str, Any], dict[str, Path]]:
    """Return what a configuration says, and where its folders are."""
    values = util.load_json(str(file), js_comments=True)
    folders = {name: (file.parent / values.pop(name)).resolve() for name in FOLDERS}
    return values, folders


def test_committed_results_are_read_by_a_configuration_that_differs_in_folders_alone() -> None:
    values, folders = configuration(ROOT / "asv.conf.json")
    reference_values, reference_folders = configuration(ROOT / "benchmarks/asv.reference.conf.json")
    assert reference_values == values
    differing = {name for name in FOLDERS if folders[name] != reference_folders[name]}
    assert differing == {"results_dir", "html_dir"}
    assert reference_folders["results_dir"] == ROOT / "results/asv"


def test_a_release_brings_its_own_mjx_and_takes_it_away() -> None:
    values, _ = configuration(ROOT / "asv.conf.json")
    assert any("jax==" in command for command in values["install_command"])
    assert "mujoco-mjx<=" in values["install_command"][-1]
    assert "mujoco-mjx" in values["uninstall_command"][0]


def test_results_keep_the_name_of_the_committed_ones() -> None:
    """Whatever else the matrix requires becomes part of it, but for asv's own package."""
    values, _ = configuration(ROOT / "asv.conf.json")
    ((name, (version,)),) = (
        (name, versions)
        for name, versions in values["matrix"]["req"].items()
        if name != "pip+asv_runner"
    )
    assert list((ROOT / "results/asv/kvm-2core").glob(f"*-virtualenv-py3.11-{name}{version}.json"))
