"""The simulation of verdicts: what is drawn, and the page that is written from it."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.studies import (
    page_part,
    simulated_launches,
    tally_file,
    verdict_page,
    verdict_simulation,
    verdict_tally,
)
from benchmarks.studies.page_part import of_lines
from benchmarks.studies.simulated_launches import Scenario, simulate
from mjbench.paired.verdict import VerdictPlan, judge


@pytest.mark.parametrize(
    "scenario",
    [Scenario("as shipped", disturbed=0.1), Scenario("placed", placed=True)],
    ids=lambda s: s.name,
)
def test_simulated_comparisons_end_as_judge_says(scenario: Scenario) -> None:
    """The simulation judges many comparisons at once; here they are judged one by one."""
    plan, seed, change = VerdictPlan(), 3, 0.01
    outcomes = simulate(scenario, change, 6, plan, seed=seed)
    rng = np.random.default_rng([seed, round(1e5 * (1 + change))])
    drawn = simulated_launches._Launches.draw(rng, scenario, 6)
    for i in range(6):
        log_ratios = list(drawn.log_ratios[i] + np.log1p(change))
        residues = drawn.residues[i].tolist() if drawn.residues is not None else None
        for n in range(1, scenario.most + 1):
            judgement = judge(log_ratios[:n], plan, residues[:n] if residues else None)
            if judgement.enough:
                break
        assert (n, judgement.verdict) == (outcomes.launches[i], outcomes.verdicts[i])
        assert np.log(judgement.ratio.estimate) - np.log1p(change) == pytest.approx(
            outcomes.errors[i]
        )
        assert judgement.e_slower == pytest.approx(outcomes.e_slower[i])


def test_simulated_placements_are_balanced() -> None:
    scenario = Scenario("placed", placed=True, most=24)
    drawn = simulated_launches._Launches.draw(np.random.default_rng(0), scenario, 5)
    for order in drawn.residues.tolist():
        assert all(set(order[start : start + 4]) == {0, 1, 2, 3} for start in range(0, 24, 4))


def test_the_page_is_written_from_the_committed_tally(tmp_path: Path) -> None:
    tally = verdict_tally.load(verdict_simulation.TALLY)
    assert verdict_page.PART.text() == of_lines(verdict_page.lines(tally))
    tally_file.write(tmp_path / "verdicts.json", tally)
    assert verdict_simulation.TALLY.read_bytes() == (tmp_path / "verdicts.json").read_bytes()
    names = [scenario.name for scenario in verdict_tally.SCENARIOS]
    assert [row.scenario for row in tally.scenarios[:: len(verdict_tally.CHANGES)]] == names


def test_a_family_is_tallied(monkeypatch: pytest.MonkeyPatch) -> None:
    certain = replace(Scenario("certain"), deviation=0.003)
    monkeypatch.setattr(verdict_tally, "_COMBINED", certain)
    rows = [row for row in verdict_tally.family_rows(20) if row.scenario == "certain"]
    assert [row.rule for row in rows[::4]] == [
        "each verdict alone",
        "e-values of the family",
        "confidence of 99.9 %",
    ]
    for row in rows:
        assert row.failed == (row.change >= 0.01) or row.change == 0.005
        assert row.wrong == 0


def test_the_command_prints_some_scenarios(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(page_part, "DOCS", tmp_path)
    monkeypatch.setattr(verdict_simulation, "TALLY", tmp_path / "verdicts.json")
    verdict_simulation.main(["--comparisons", "3", "--only", "at most 8"])
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 2 * len(verdict_tally.CHANGES)
    assert lines[0].startswith("| at most 8 launches | 0 % |")
    assert not list(tmp_path.iterdir())
