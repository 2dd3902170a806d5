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


def test_own_results_are_ignored_by_git() -> None:
    ignored = (ROOT / ".gitignore").read_text().splitlines()
    assert ".asv/" in ignored
    for name in ("asv.conf.json", "benchmarks/asv.mjx.conf.json"):
        _, folders = configuration(ROOT / name)
        assert folders["results_dir"].is_relative_to(ROOT / ".asv")
