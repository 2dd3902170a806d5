"""Two run files held against each other."""

import json
from pathlib import Path

import pytest
from commands import ROOT, mjbench

from mjbench.errors import InputError
from mjbench.instrument import stats

RUNS = ROOT / "results/runs"


def test_results_that_differ_in_identity_are_not_compared_unless_asked() -> None:
    old = stats.TimedBlocks([1.0] * 9, {"jax": "0.10.1", "device": "cpu"})
    new = stats.TimedBlocks([2.0] * 9, {"jax": "0.10.2", "device": "cpu"})
    with pytest.raises(InputError, match=r"differ in jax \(0.10.2, 0.10.1\)"):
        stats.unpaired(new, old)
    assert stats.unpaired(new, old, across=True).median == pytest.approx(2.0)
    assert stats.unpaired(old, old).median == pytest.approx(1.0)


def run_file(folder: Path, name: str, jax: str, seconds: float) -> Path:
    machine = {"cpu": "c", "versions": {"jax": jax}, "flags": {}}
    measurement = {
        "type": "measurement",
        "model": "m",
        "path": "mjx",
        "options": {},
        "nbatch": 2,
        "nstep": 5,
        "status": "ok",
        "agrees": True,
        "precision": "float32",
        "device": "cpu",
        "workload_digest": "w",
        "samples_s": [seconds] * 9,
    }
    head = {"type": "run", "schema": 1, "command": "compare", "machine": machine}
    file = folder / name
    file.write_text(f"{json.dumps(head)}\n{json.dumps(measurement)}\n")
    return file


def test_diff_compares_run_files_and_refuses_other_versions_of_jax(tmp_path: Path) -> None:
    old = run_file(tmp_path, "old.jsonl", "1", 1.0)
    new = run_file(tmp_path, "new.jsonl", "2", 1.5)
    refused = mjbench("diff", str(old), str(new))
    assert refused.returncode == 2
    assert "they differ in jax (2, 1)" in refused.stdout
    alone = mjbench("diff", str(old), str(RUNS / "reference-selfcheck-quiet.jsonl"))
    assert alone.returncode == 2
    assert "no timed row" in alone.stderr
    compared = mjbench("diff", str(old), str(new), "--across", "--json", "-")
    assert compared.returncode == 0, compared.stderr
    assert json.loads(compared.stdout)["results"][0]["ratio"]["estimate"] == pytest.approx(1.5)
