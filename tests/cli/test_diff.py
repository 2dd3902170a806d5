"""`mjbench diff`: two run files of `compare`."""

import json
from dataclasses import replace
from pathlib import Path

import pytest
from commands import ROOT, mjbench
from example_records import measurement, model_record

from mjbench.instrument import machine, run_file, runs

RUNS = ROOT / "results/runs"


def stored_run(folder: Path, jax: str, seconds: float) -> str:
    versions = {"jax": jax}
    file = run_file.RunFile.create(
        folder,
        runs.RunHeader(runs.SCHEMA, "compare", replace(machine.describe(), versions=versions), {}),
    )
    file.append(model_record())
    file.append(measurement(path="mjx", precision="float32", device="cpu", samples_s=[seconds] * 9))
    file.close()
    return str(file.path)


def test_diff_compares_run_files_and_refuses_other_versions_of_jax(tmp_path: Path) -> None:
    old = stored_run(tmp_path / "old", "1", 1.0)
    new = stored_run(tmp_path / "new", "2", 1.5)
    refused = mjbench("diff", old, new)
    assert refused.returncode == 2
    assert "they differ in jax (2, 1)" in refused.stdout
    compared = mjbench("diff", old, new, "--across", "--json", "-")
    assert compared.returncode == 0, compared.stderr
    assert json.loads(compared.stdout)["results"][0]["ratio"]["estimate"] == pytest.approx(1.5)


def test_run_files_with_nothing_in_common_are_bad_input(tmp_path: Path) -> None:
    old = stored_run(tmp_path, "1", 1.0)
    done = mjbench("diff", old, str(RUNS / "reference-selfcheck-quiet.jsonl"))
    assert done.returncode == 2
    assert "no timed row" in done.stderr
