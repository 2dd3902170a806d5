"""Changes that are known, and what the page says of them; nothing is measured."""

from dataclasses import replace

import pytest

from benchmarks.studies import tally_file, truths
from benchmarks.studies.page_part import of_lines
from benchmarks.studies.truth_tally import Answer, Truth, TruthResult, TruthTally
from benchmarks.studies.truths import FOLDER, PART, TALLY, TRUTHS
from mjbench.interval import Interval
from mjbench.paired.outcomes import Verdict
from mjbench.simulation import models

TRUTH = Truth(
    "A 2.0: sums", ("1", "2", "m"), 4.0, True, ("its notes", "https://a"), ("1", "1", "m")
)


def result(verdict: Verdict | None, ratio: float, control: Verdict = Verdict.SAME) -> TruthResult:
    answer = Answer(TRUTH.arguments, verdict, Interval(ratio, None, None), 20.0, 3.0)
    return TruthResult(answer, replace(answer, arguments=TRUTH.control, verdict=control))


def lines(*results: TruthResult) -> str:
    return "\n".join(TruthTally("4.0.0", "a processor", 2, results).lines([TRUTH]))


@pytest.mark.parametrize(
    ("verdict", "ratio", "is_found", "has_size"),
    [
        (Verdict.SLOWER, 4.0, True, True),
        (Verdict.SLOWER, 2.1, True, True),
        (Verdict.SLOWER, 1.9, True, False),
        (Verdict.SLOWER, 9.0, True, False),
        (Verdict.FASTER, 4.0, False, False),
        (Verdict.INCONCLUSIVE, 4.0, False, False),
        (None, 4.0, False, False),
    ],
)
def test_a_change_is_found_in_its_direction_and_with_about_its_size(
    verdict: Verdict | None, ratio: float, is_found: bool, has_size: bool
) -> None:
    found = result(verdict, ratio)
    assert (found.is_found(TRUTH), found.has_size(TRUTH)) == (is_found, has_size)


def test_a_change_without_a_published_size_has_none_to_find() -> None:
    unsized = replace(TRUTH, change=None)
    assert result(Verdict.SLOWER, 4.0).is_found(unsized)
    assert not result(Verdict.SLOWER, 4.0).has_size(unsized)
    assert result(Verdict.FASTER, 0.5).is_found(replace(unsized, is_more=False))


def test_the_page_counts_what_is_found_and_names_what_is_not() -> None:
    found = lines(result(Verdict.SLOWER, 5.0))
    assert "finds 1 of 1 changes that others have published. For 1 of them" in found
    assert "Of 1 published sizes, 1 are found" in found
    missed = lines(result(Verdict.SAME, 1.001, control=Verdict.SLOWER))
    assert "finds 0 of 1 changes that" in missed
    assert "(not A 2.0: sums: same, × 1.001). For 0 of them" in missed


def test_an_answer_to_another_question_is_not_shown() -> None:
    other = result(Verdict.SLOWER, 5.0)
    other = replace(other, control=replace(other.control, arguments=("1", "3", "m")))
    assert "finds 0 of 0 changes" in lines(other)


def test_each_change_is_measured_once_and_stored_before_the_next(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    asked: list[tuple[str, ...]] = []

    def ask(arguments: tuple[str, ...]) -> Answer:
        asked.append(arguments)
        return Answer(arguments, Verdict.SAME, Interval(1.0, None, None), 1.0, 0.0)

    monkeypatch.setattr(truths, "ask", ask)
    earlier = TruthTally("4.0.0", "a processor", 2, [result(Verdict.SLOWER, 4.0)])
    tally = truths.measure([TRUTH], earlier, writes=False)
    assert asked == [TRUTH.arguments, TRUTH.control]
    assert [each.answer.verdict for each in tally.results] == [Verdict.SAME]


def test_what_is_compared_exists() -> None:
    assert len({truth.name for truth in TRUTHS}) == len(TRUTHS) <= 12
    for truth in TRUTHS:
        assert truth.arguments != truth.control
        for arguments in (truth.arguments, truth.control):
            file, _, name = arguments[2].partition("::")
            if name:
                assert f"\ndef {name}() ->" in (FOLDER / file).read_text()
            else:
                assert file in models.shipped() or (FOLDER / file).is_file()


def test_the_page_has_the_committed_answers() -> None:
    tally = tally_file.load(TALLY, TruthTally, "changes")
    assert PART.text() == of_lines(tally.lines(TRUTHS))
    assert len([*tally.known(TRUTHS)]) == len(tally.results)
