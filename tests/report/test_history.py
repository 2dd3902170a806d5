import math

from commands import ROOT
from histories import counted, history, timed

from mjbench.releases import asv_results, bundle, causes
from mjbench.releases.benchmark_names import BenchmarkName
from mjbench.releases.causes import Cause
from mjbench.report.history import page


def test_the_page_names_change_points_causes_and_gaps() -> None:
    series = timed(1.0e-3, 1.0e-3, math.nan, 1.5e-3, 1.5e-3, None)
    ratios = counted(BenchmarkName.RATIO_TO_REFERENCE, 1.0, 1.0, math.nan, 1.4, 1.4, 1.4)
    contacts = counted(BenchmarkName.CONTACTS, 1, 1, 1, 5, 5, 5)
    known = [Cause("1.3", "pole", "abc123", "more contacts")]
    text = page(history(series, ratios, contacts), known)
    assert "| 1.3 | `pole` | +40.0 % |" in text
    assert "| contacts 1 → 5 |" in text
    assert "more contacts (`abc123`)" in text
    assert "| not applicable | 1.2 |" in text
    assert "| failed | 1.5 |" in text
    assert "| 1.3 | 1.5▲ |" in text


def test_instructions_stand_beside_a_change_point_and_in_their_own_table() -> None:
    series = timed(1.0e-3, 1.0e-3, 1.5e-3)
    ratios = counted(BenchmarkName.RATIO_TO_REFERENCE, 1.0, 1.0, 1.4)
    counts = counted(BenchmarkName.INSTRUCTIONS, 10_000.0, 10_050.0, 11_100.0)
    text = page(history(series, ratios, counts), [])
    assert "| 1.2 | `pole` | +40.0 % | +50.0 %, +50.0 % | +10.4 % | the same |" in text
    assert "| 1.1 | 10.05 |" in text
    assert "| 1.2 | 11.1▲ |" in text
    assert "Not counted." in page(history(series, ratios), [])


def test_a_history_without_change_says_so_in_every_section() -> None:
    text = page(history(timed(*[1.0e-3] * 6)), [])
    assert text.count("None above 5 %.") == 2
    assert "None: every benchmark was measured in every release." in text


def test_the_committed_page_is_what_the_committed_results_show() -> None:
    measured = asv_results.load(ROOT / "results/asv", bundle.default_path())
    known = causes.load(ROOT / "benchmarks/causes.toml")
    committed = (ROOT / "docs/history.md").read_text()
    assert committed == page(measured, known), "mjbench history -o docs/history.md"
