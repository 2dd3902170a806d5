"""Reports of several machines: what they show side by side comes first."""

from dataclasses import replace
from pathlib import Path

import pytest
from example_records import measurement, model_record
from set_files import labelled, run_file, set_of
from speed_histories import VERSIONS, record
from verdict_records import FAILED, FASTER, OPEN, SAME, SLOWER, of_model

from mjbench.pages import reports
from mjbench.pages.reports import NamedRun
from mjbench.report.content import Report, Tone
from mjbench.status import Status
from mjbench.store.runs import Record

OF_A_HISTORY = (
    "What changed between releases",
    "Change points of a step",
    "Single releases that are off",
    "Drifts",
    "Changed by placement",
    "From the first release to the last",
    "Plots",
    "Time of a step",
    "Instructions of a step",
    "Releases that compute something else",
)


def verdict_runs(folder: Path, **records: Record) -> list[Path]:
    """Return run files of machines with a verdict each."""
    return [
        run_file(folder, labelled(name), one, command="versions") for name, one in records.items()
    ]


def report(*files: Path) -> Report:
    return reports.build(reports.read(files))


def texts(content: Report) -> list[str]:
    return [conclusion.text for conclusion in content.conclusions]


def test_a_set_is_reported_side_by_side_first_and_then_run_by_run(tmp_path: Path) -> None:
    files = verdict_runs(tmp_path, a=SLOWER, b=SAME)
    content = report(set_of(tmp_path / "set.jsonl", files))
    assert [section.heading for section in content.sections] == [
        "Across machines",
        "a: Verdicts",
        "b: Verdicts",
    ]
    first, *_ = content.sections
    assert [table.title for table in first.tables] == [
        "Verdicts by machine",
        "On how many machines",
    ]
    assert [column.title for column in first.tables[0].columns] == ["comparison", "a", "b"]
    assert [row[0] for row in content.machines.rows] == ["a", "b"]
    assert first.command.startswith("mjbench report ")
    # what runs show alone is in their sections
    assert len(content.conclusions) == 2
    assert "slower on 1 of 2 machines, same on 1" in texts(content)[1]
    assert content == replace(report(*files), sections=content.sections, machines=content.machines)


@pytest.mark.parametrize(
    ("verdicts", "tone"),
    [
        ((SLOWER, FASTER), Tone.BAD),
        ((FASTER, OPEN), Tone.GOOD),
        ((SAME, SAME), Tone.NEUTRAL),
        ((SAME, FAILED), Tone.UNSURE),
    ],
)
def test_a_conclusion_has_the_tone_of_the_worst_machine(
    tmp_path: Path, verdicts: tuple[Record, Record], tone: Tone
) -> None:
    a, b = verdicts
    assert report(*verdict_runs(tmp_path, a=a, b=b)).conclusions[1].tone == tone


def test_runs_of_one_machine_are_reported_as_before(tmp_path: Path) -> None:
    files = [*verdict_runs(tmp_path, a=SLOWER), *verdict_runs(tmp_path, a=of_model(SAME, "n"))]
    content = report(*files)
    assert [section.heading for section in content.sections] == ["Verdicts", "Verdicts"]
    assert texts(content)[0].startswith("m, 1.0.0 → 2.0.0: slower by 3 %")


def test_a_run_that_is_in_two_files_is_reported_once(tmp_path: Path) -> None:
    files = verdict_runs(tmp_path, a=SLOWER, b=SAME)
    content = report(*files, set_of(tmp_path / "set.jsonl", files))
    assert len(content.sections) == 3


def test_paths_that_disagree_stand_at_the_head_whichever_machine(tmp_path: Path) -> None:
    wrong = measurement(
        path="rollout", status=Status.DISAGREES, agrees=False, agreement="qpos differs"
    )
    plain = measurement(samples_s=[0.01, 0.011, 0.012])
    files = [
        run_file(tmp_path, labelled("a"), model_record(), plain, wrong),
        run_file(tmp_path, labelled("b"), model_record(), plain),
    ]
    content = report(*files)
    assert [section.heading for section in content.sections] == [
        "Across machines",
        "a: m: 10 simulations × 100 steps",
        "b: m: 10 simulations × 100 steps",
    ]
    assert content.sections[0].tables[0].title == "Advised paths by machine"
    bad = [c.text for c in content.conclusions if c.tone == Tone.BAD]
    assert bad == [
        "a: m, 10 simulations: rollout does other work than the plain loop: qpos differs"
    ]


def test_a_set_of_many_runs_leaves_sections_out_and_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(reports, "_MOST_SECTIONS", 4)
    files = [
        run_file(tmp_path, labelled(name), of_model(SAME, model), command="versions")
        for name in "ab"
        for model in "mno"
    ]
    failed = run_file(tmp_path, labelled("b"), of_model(FAILED, "p"), command="versions")
    content = report(*files, failed)
    assert [section.heading for section in content.sections] == [
        "Across machines",
        *["a: Verdicts"] * 3,
        "b: Verdicts",
    ]
    assert content.sections[-1].conclusions[0].text.endswith("signal 11")
    assert texts(content)[-1].startswith("Left out: 3 of 7 sections of single runs.")
    # all comparisons are in the first tables
    assert len(content.sections[0].tables[0].rows) == 4


def test_many_comparisons_have_some_sentences_and_all_rows(tmp_path: Path) -> None:
    records = [of_model(SAME, f"m{n}") for n in range(40)]
    files = [run_file(tmp_path, labelled(name), *records, command="versions") for name in "ab"]
    content = report(*files)
    assert "10 further comparisons are only in the tables." in texts(content)
    assert len(content.sections[0].tables[0].rows) == 40


def test_of_many_machines_each_cell_is_a_row(tmp_path: Path) -> None:
    files = verdict_runs(tmp_path, **{f"m{n}": SAME for n in range(9)})
    table = report(*files).sections[0].tables[0]
    assert [column.title for column in table.columns] == ["comparison", "machine", "result"]
    assert len(table.rows) == 9


def test_histories_of_several_machines_are_apart(tmp_path: Path) -> None:
    step = [1.0] * 4 + [1.1] * 4
    files = [
        run_file(
            tmp_path,
            labelled(name),
            *(record(v, r) for v, r in zip(VERSIONS, ratios, strict=False)),
            command="history",
        )
        for name, ratios in (("a", step), ("b", [1.0] * 8))
    ]
    content = report(*files)
    assert [section.heading for section in content.sections] == [
        "What changed between releases, by machine",
        *(f"{name}: {heading}" for name in "ab" for heading in OF_A_HISTORY),
    ]
    assert texts(content) == ["1 change is listed on 2 machines: 1 on one machine alone."]
    (row,) = content.sections[0].tables[0].rows
    assert row[0] == "1.3 → 1.4, pile: slower on 1 of 2"


def test_the_command_of_a_section_names_some_files(tmp_path: Path) -> None:
    runs = [
        NamedRun(Path(f"{n}.jsonl"), named.run)
        for n, named in enumerate(
            reports.read(verdict_runs(tmp_path, a=SAME, b=SAME, c=SAME, d=SAME))
        )
    ]
    assert reports.build(runs).sections[0].command == ("mjbench report 0.jsonl 1.jsonl 2.jsonl …")
