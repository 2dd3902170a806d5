"""All outputs of a comparison have the same speed-up of a path, and first what disturbed it."""

import csv
import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner
from example_races import BATCH_STEP, CLEAR, ROLLOUT, compared, raced
from set_files import labelled, run_file

import mjbench
from mjbench import formats
from mjbench.api.compare import Comparison
from mjbench.cli import cli
from mjbench.commands.compare.results import PathResult, derive_all
from mjbench.commands.show import exports, forms, machine_comparison, reports
from mjbench.commands.show.kinds import RECORD_TYPES
from mjbench.commands.show.reports import NamedRun
from mjbench.host.disturbance import Disturbance
from mjbench.results import html, markdown, runs, terminal
from mjbench.results.content import Report, Tone
from mjbench.results.runs import Run
from mjbench.verification.plan import WITHOUT_TIMER

DESK, LAPTOP = labelled("desk"), labelled("laptop")
# A path's speed-up, and the ends of its interval.
Gain = tuple[float, float | None, float | None]


def stored(folder: Path, **disturbance: Any) -> Path:
    """Return a run file of a race in which rollout and Batch.step won."""
    record = raced([*CLEAR, (WITHOUT_TIMER, 1.2)], spread=0.02, **disturbance)
    began = "2026-11-26T12:00:00+00:00"
    return run_file(folder, DESK, *compared(record), began=began)


def results_of(file: Path) -> list[PathResult]:
    (model_results,) = derive_all(read(file).records)
    return list(model_results.results)


def read(file: Path) -> Run:
    return runs.load(file, RECORD_TYPES)


def report_of(file: Path) -> Report:
    return reports.build([NamedRun(file, read(file))])


def invoked(*words: str | Path) -> str:
    done = CliRunner().invoke(cli, [*map(str, words)])
    assert done.exit_code == 0, done.output
    return done.stdout


# numbers


def of_rows(rows: list[dict[str, Any]]) -> list[Gain]:
    ends = ("speedup.estimate", "speedup.low", "speedup.high")
    return [tuple(float(row[name]) for name in ends) for row in rows]  # type: ignore[misc]


def of_document(file: Path) -> list[Gain]:
    document = json.loads(invoked("show", file, "--json", "-"))
    speedups = [result["speedup"] for result in document["results"]]
    return [(each["estimate"], each["low"], each["high"]) for each in speedups]


def of_notebook_document(file: Path) -> list[Gain]:
    speedups = [result.speedup for result in Comparison(read(file)).results]
    return [(each.estimate, each.low, each.high) for each in speedups if each is not None]


def of_csv(file: Path) -> list[Gain]:
    table = forms.of_runs([NamedRun(file, read(file))]).csv()
    return of_rows(list(csv.DictReader(table.splitlines())))


NUMBERS: dict[str, Callable[[Path], list[Gain]]] = {
    "load": lambda file: of_rows(mjbench.load(file)),
    "json": of_document,
    "api": of_notebook_document,
    "csv": of_csv,
}


@pytest.mark.parametrize("output", NUMBERS)
def test_speed_up_and_interval_are_those_of_the_race_to_the_last_digit(
    output: str, tmp_path: Path
) -> None:
    file = stored(tmp_path)
    expected = [
        (r.speedup.estimate, r.speedup.low, r.speedup.high)
        for r in results_of(file)
        if r.speedup is not None
    ]
    assert len(expected) == 5
    assert NUMBERS[output](file) == expected


def test_the_chart_has_the_numbers_of_the_table(tmp_path: Path) -> None:
    file = stored(tmp_path)
    (section,) = report_of(file).sections
    drawn = {row["path"]: row for row in section.figures[0].specification["data"]["values"]}
    for result in results_of(file)[1:]:
        row, speedup = drawn[str(result.variant)], result.speedup
        assert speedup is not None
        assert (row["speed-up"], row["low"], row["high"]) == (
            speedup.estimate,
            speedup.low,
            speedup.high,
        )


def test_other_tools_get_the_time_of_the_plain_loop_over_the_speed_up(tmp_path: Path) -> None:
    file = stored(tmp_path)
    times = [result.step_ns for result in results_of(file)]
    action = json.loads(exports.as_github_action_benchmark(read(file)))
    assert [entry["value"] for entry in action] == times


# texts


def of_set(file: Path) -> str:
    compared = machine_comparison.of_runs([read(file)])
    section = machine_comparison.section(compared)
    assert section is not None
    return "\n".join([*compared.cautions, terminal.text_of([section])])


TEXTS: dict[str, Callable[[Path], str]] = {
    "terminal": lambda file: str(Comparison(read(file))),
    "show": lambda file: invoked("show", file),
    "markdown": lambda file: "\n".join(markdown.render(report_of(file))),
    "html": lambda file: html.render(report_of(file)),
    "notebook": lambda file: Comparison(read(file))._repr_markdown_(),
    "side by side": of_set,
}


@pytest.fixture
def needs_the_report_extra() -> None:
    pytest.importorskip("jinja2")
    pytest.importorskip("vl_convert")


@pytest.mark.usefixtures("needs_the_report_extra")
@pytest.mark.parametrize("output", TEXTS)
def test_every_text_has_the_speed_ups_that_are_advised_in_the_same_digits(
    output: str, tmp_path: Path
) -> None:
    file = stored(tmp_path)
    text = re.sub(r"<[^>]*>", " ", TEXTS[output](file))
    advised = {str(ROLLOUT), str(BATCH_STEP)}
    for result in results_of(file):
        speedup = result.speedup
        if str(result.variant) not in advised or speedup is None:
            continue
        assert speedup.low is not None
        assert speedup.high is not None
        numbers = map(formats.factor, (speedup.estimate, speedup.low, speedup.high))
        row = rf"{re.escape(str(result.variant))}\b.*?\D" + r"\D{1,9}".join(numbers)
        assert re.search(row, text), row


@pytest.mark.usefixtures("needs_the_report_extra")
@pytest.mark.parametrize("output", ["terminal", "show", "markdown", "html", "notebook"])
def test_the_conclusions_stand_before_the_table_with_its_numbers(
    output: str, tmp_path: Path
) -> None:
    file = stored(tmp_path)
    text = TEXTS[output](file)
    (speedup,) = (r.speedup for r in results_of(file) if r.variant == BATCH_STEP)
    assert speedup is not None
    gain = formats.factor(speedup.estimate)
    conclusion = f"For RL (closed loop): Batch.step on 2 threads, {gain}"
    assert conclusion in text
    assert text.index(conclusion) < text.index("ns/step")


# what to know before the numbers


@pytest.mark.usefixtures("needs_the_report_extra")
@pytest.mark.parametrize("output", TEXTS)
def test_what_disturbed_a_run_comes_before_everything_else(output: str, tmp_path: Path) -> None:
    text = TEXTS[output](stored(tmp_path, cores=1.2))
    caution = "Disturbed: threads had 1.20 of 2 cores. Measure again."
    assert caution in text
    assert text.index(caution) < text.index("rollout")
    assert "✓ rollout" not in text
    if output in ("terminal", "show", "side by side"):
        assert text.strip().splitlines()[0].endswith(caution)


def test_the_first_conclusion_of_a_report_is_what_disturbed_it(tmp_path: Path) -> None:
    first, *others = report_of(
        stored(tmp_path, disturbance=Disturbance(stolen_share=0.3))
    ).conclusions
    assert first.tone == Tone.CAUTION
    assert first.text == (
        "m, 10 simulations: Disturbed: the host took 30 % of the processor time for others. Measure"
        " again."
    )
    assert {each.tone for each in others if "loop)" in each.text} == {Tone.UNSURE}


def test_of_several_machines_a_report_says_which_was_disturbed(tmp_path: Path) -> None:
    files = [stored(tmp_path / "a", cores=1.2), stored(tmp_path / "b")]
    other = read(files[1])
    runs_of_two = [
        NamedRun(files[0], read(files[0])),
        NamedRun(files[1], replace(other, header=replace(other.header, machine=LAPTOP))),
    ]
    first = reports.build(runs_of_two).conclusions[0]
    assert first.text.startswith("desk: m, 10 simulations: Disturbed: threads had 1.20 of 2 cores")


def test_rows_documents_and_other_tools_say_what_disturbed_a_run(tmp_path: Path) -> None:
    file = stored(tmp_path, cores=1.2)
    clause = "threads had 1.20 of 2 cores"
    assert {row["disturbances"] for row in mjbench.load(file)} == {clause}
    document = json.loads(invoked("show", file, "--json", "-"))
    assert all(result["disturbances"] == [clause] for result in document["results"])
    assert not any(advice["is_certain"] for advice in document["advice"])
    action = json.loads(exports.as_github_action_benchmark(read(file)))
    assert {entry["extra"] for entry in action} == {f"Disturbed: {clause}. Measure again."}
    for form in ("csv", "junit"):
        done = CliRunner().invoke(cli, ["show", str(file), f"--{form}", "-"])
        assert f"m: Disturbed: {clause}" in done.stderr


def test_a_difference_to_a_disturbed_run_says_so_first(tmp_path: Path) -> None:
    old, new = stored(tmp_path / "old"), stored(tmp_path / "new", cores=1.2)
    assert invoked("show", old, new).lstrip().startswith("NEW: threads had 1.20 of 2 cores\n")
