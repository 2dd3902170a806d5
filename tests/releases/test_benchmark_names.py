import json

from commands import ROOT

from mjbench.releases.benchmark_names import BenchmarkName


def test_asv_has_results_of_every_benchmark_that_is_used_by_name() -> None:
    known = json.loads((ROOT / "results/asv/benchmarks.json").read_text())
    assert set(BenchmarkName) <= set(known)
