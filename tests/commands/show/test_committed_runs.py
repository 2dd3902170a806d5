"""The committed runs are readable and complete, and say what the documentation says of them."""

import json
import re
from pathlib import Path

import pytest
from commands import ROOT
from committed_trials import RUNS

from mjbench.commands.compare.advice import advise
from mjbench.commands.compare.results import derive_all
from mjbench.commands.show.kinds import RECORD_TYPES
from mjbench.paired.race_record import Loop
from mjbench.paths import BASE
from mjbench.results import runs
from mjbench.simulation.accelerated_judgement import EngineAnswer
from mjbench.status import Status

COMPARISONS = sorted(RUNS.glob("reference-mujoco-*.jsonl"))
STORY = sorted(RUNS.glob("reference-story-*.jsonl"))
CHECKUP = RUNS / "reference-checkup-humanoid.jsonl"
ENVIRONMENTS = RUNS / "reference-environments.jsonl"
MJX = RUNS / "reference-mjx-cpu.jsonl"
GPU = sorted(RUNS.glob("reference-gpu-*.jsonl"))


def test_every_committed_run_is_tested_and_there_is_one_of_each_kind() -> None:
    assert COMPARISONS
    series = {*COMPARISONS, *STORY, *GPU}
    committed = series | {CHECKUP, ENVIRONMENTS, MJX}
    assert committed == set(RUNS.glob("reference-*.jsonl"))


@pytest.mark.parametrize("file", sorted((ROOT / "results").glob("*/reference-*.jsonl")))
def test_no_committed_run_names_a_folder_of_the_machine_that_wrote_it(file: Path) -> None:
    header = json.loads(file.read_text().splitlines()[0])
    texts = [*header["command_line"], json.dumps(header["arguments"])]
    assert not any(re.search(r"(^|[\s\"=])/\w", text) for text in texts)


@pytest.mark.parametrize("file", COMPARISONS, ids=lambda f: f.stem)
def test_the_committed_comparison_is_complete_and_every_path_agreed(file: Path) -> None:
    """Complete: every path on every model that its header names."""
    run = runs.load(file, RECORD_TYPES)
    groups = derive_all(run.records)
    assert [group.model.model for group in groups] == run.header.arguments["models"]
    assert groups
    for group in groups:
        variants = [{"path": r.path, "options": r.options} for r in group.results]
        assert variants == run.header.arguments["variants"], group.model.model
        compared = [r for r in group.results if r.status != Status.UNAVAILABLE]
        assert {r.path for r in group.results if r not in compared} <= {"mjx", "mjx64"}
        assert all(result.agrees and result.step_ns for result in compared)
        advice = advise(group)
        assert {row.loop for row in advice} == set(Loop)
        assert all(row.speedup and row.speedup.is_above(1) for row in advice if row.path != BASE)


@pytest.mark.parametrize("file", GPU, ids=lambda f: f.stem)
def test_what_a_gpu_computed_agrees_and_is_timed_also_where_c_was_not(file: Path) -> None:
    groups = derive_all(runs.load(file, RECORD_TYPES).records)
    compiled = [r for group in groups for r in group.results if r.compile_s is not None]
    answers = {r.judgement.answer for r in compiled if r.judgement is not None}
    (device,) = {r.device for r in compiled}
    assert device in ("NVIDIA H200", "NVIDIA H100 80GB HBM3")
    assert answers == {EngineAnswer.YES}
    assert all(result.step_ns and result.steps_per_s for result in compiled)
    beside_c = [group.base is not None and group.base.is_timed for group in groups]
    assert [r.speedup is not None for r in compiled] == [
        timed
        for group, timed in zip(groups, beside_c, strict=True)
        for r in group.results
        if r.compile_s is not None
    ]


def test_the_story_has_the_commands_of_its_runs() -> None:
    page = (ROOT / "docs/guides/story.md").read_text()
    for file in STORY:
        words = runs.load(file, RECORD_TYPES).header.command_line
        assert any(" ".join(words[:2]) in line for line in page.splitlines()), words
