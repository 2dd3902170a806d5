"""The race of `compare` on stored launches: the tally, and the page that has it."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.studies import foreign, foreign_tally, races
from benchmarks.studies.page_part import of_lines
from benchmarks.studies.tally_file import load
from mjbench.paired.race_record import RaceLaunch, RaceRecord
from mjbench.verification.plan import Variant

SPEEDS = [1.0, 1.3, 2.0, 1.3]


def stored(spread: float, twice_as_slow: float = 1.0) -> RaceRecord:
    """Return launches of four variants, the last of which is the second once more."""
    rng = np.random.default_rng(0)
    speeds = np.array(SPEEDS) / [1.0, 1.0, 1.0, twice_as_slow]
    launches = []
    for _ in range(30):
        ns = np.round(1e7 / speeds * np.exp(rng.normal(0, spread, len(speeds)))).astype(int)
        launches.append(RaceLaunch(None, range(len(speeds)), [ns.tolist()] * 4))
    names = ["python_loop", "rollout", "batch", "rollout"]
    return RaceRecord(
        model="m",
        steps=1000,
        variants=[Variant(name, {}) for name in names],
        groups=[[0, 1, 2], [0, 1]],
        launches=launches,
    )


def test_clear_differences_are_decided_without_regret() -> None:
    row = races.tally(stored(0.01), 10, np.random.default_rng(1))
    assert (row.regret, row.dropped, row.decided) == (0.0, 0.0, 1.0)
    assert (row.races, row.launches, row.entrants) == (10, 30, 4)
    assert row.covered_final > 0.8
    assert row.half_width < 0.02


def test_a_path_that_differs_from_itself_is_counted() -> None:
    row = races.tally(stored(0.002, twice_as_slow=1.1), 5, np.random.default_rng(1))
    assert row.faster_than_itself == 1.0


@pytest.mark.parametrize("study", [races.SHIPPED, races.FOREIGN], ids=lambda study: study.name)
def test_the_page_has_the_stored_tally(study: races.Study) -> None:
    if not study.tally_file.exists():
        pytest.skip("no tally is stored")
    stored_tally = load(study.tally_file, races.RaceTally, "races")
    assert study.part.text() == of_lines(races.lines(stored_tally))


def test_foreign_models_are_files_of_packages_on_which_all_c_paths_agree() -> None:
    tally = foreign_tally.load(foreign.TALLY)
    agreeing = {package.name: package.agreeing for package in tally.packages}
    assert len(races.FOREIGN_MODELS) == 5
    assert all(file in agreeing[name] for name, file in races.FOREIGN_MODELS.items())


def test_the_page_names_the_models_that_are_decided_least_and_whose_intervals_hold_least() -> None:
    row = races.tally(stored(0.01), 10, np.random.default_rng(1))
    row = replace(row, covered_final=0.96)
    hard = replace(row, model="cloth", decided=0.25)
    wrong = replace(row, model="pile", covered_final=0.931)
    (text,) = races.lines(races.RaceTally("a processor", "4.0.0", [row, hard, wrong]))
    assert "the least on cloth (25 %)" in text
    assert "at least 93.1 % contain the truth (worst model: pile)" in text
