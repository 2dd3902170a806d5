"""Run files that somebody damaged: `show` prints them, or refuse them in one line."""

import copy
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner
from example_environment_records import record as environment_record
from example_races import BATCH_ROLLOUT, ROLLOUT, compared, raced
from example_records import JUDGED, measurement, model_record
from hypothesis import given, settings
from hypothesis import strategies as st

from mjbench.cli import cli
from mjbench.host import machine
from mjbench.interval import Interval
from mjbench.paired.outcomes import Cause, Verdict
from mjbench.paired.records import LaunchRow, Pair, PlacementEffect, TargetRow, VerdictRecord
from mjbench.releases.placement import Placement, PlacementPair
from mjbench.results import runs
from mjbench.simulation.accelerated_judgement import Precision
from mjbench.simulation.reference_run import Work
from mjbench.status import Status

WORK = Work(contacts=1.0, constraints=4.0, solver_iterations=2.0)
SIDE = TargetRow("3.3.0", "m", "rollout", {"threads": 2}, {"solver": "cg"})
COMPARISON = (
    model_record(usable_cores=2, nbatch_asked=10),
    measurement(samples_s=[0.1, 0.2, 0.15], nbatch_asked=10),
    measurement(
        path="rollout", options={"threads": 2}, samples_s=[0.05, 0.1, 0.07], nbatch_asked=10
    ),
    measurement(
        path="mjx", precision=Precision.FLOAT32, device="cpu", trace_s=1.0, compile_s=2.0,
        memory_bytes=10**9, judgement=JUDGED, samples_s=[0.05, 0.1, 0.07], nbatch_asked=10,
    ),
    model_record(model="n", status=Status.FAILED, detail="it failed", facts=None, work=None),
    measurement(model="n", status=Status.FAILED, agrees=None),
)  # fmt: skip
RACE = compared(
    raced([(ROLLOUT, 2.0), (BATCH_ROLLOUT, 3.0)], launches=4, slow=[2], groups=[[0, 1], [0]])
)
MOVED = PlacementPair(Placement(16, 4080), Placement(0, 64))
VERDICTS = (
    VerdictRecord(
        model="m", path="rollout", old="3.3.0", new="4.0.0", sides=(SIDE, SIDE), status=Status.OK,
        verdict=Verdict.SLOWER, ratio=Interval(1.02, 1.01, 1.03), changed_work=True,
        work=Pair(WORK, WORK), drift=1e-3, diverged=Pair(0, 1), nbatch=4, nstep=100,
        launches=8, pairs=64, seconds=2.0, cause=Cause.WORK,
        placement=PlacementEffect(True, "", Interval(1.03, 1.0, 1.05), Interval(1.01, 0.99, 1.03)),
        samples=[
            LaunchRow(0, 1.0, ["ABBA"], [[10, 11, 10, 11]]),
            LaunchRow(0, None, ["BAAB"], [[10, 11, 10, 11]], MOVED),
        ],
    ),
)  # fmt: skip
KINDS = {
    "compare": (*COMPARISON, *RACE),
    "versions": VERDICTS,
    "env": (environment_record(),),
}  # fmt: skip
FOREIGN: list[Any] = [
    None, True, 0, -1, 1, 10**30, -0.0, 1e-320, 1e308, -1e308, "", "x", "NaN", "a\x1b]52;\nb",
    "ok", "python_loop", "mjx", [], [0.0], [-1.0], [1e-320, 1e308], [[]], {}, {"a": [{}]},
    [None], "x" * 5_000,
]  # fmt: skip


def lines_of(command: str) -> list[Any]:
    header = runs.RunHeader(runs.SCHEMA, command, machine.describe(), {"nbatch": 10})
    return [{"type": r.record_type, **runs.to_json(r)} for r in (header, *KINDS[command])]


LINES = {command: json.loads(json.dumps(lines_of(command))) for command in KINDS}


def places(value: Any, place: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Yield where every value inside a JSON value is."""
    items = value.items() if isinstance(value, dict) else ()
    items = enumerate(value) if isinstance(value, list) else items
    for key, item in items:
        yield (*place, key)
        yield from places(item, (*place, key))


def replacements(value: Any) -> list[Any]:
    """Return what may stand for a value: more often than not, something of its type."""
    alike = [x for x in FOREIGN if type(x) is type(value)]
    if isinstance(value, int | float):
        alike = [x for x in FOREIGN if isinstance(x, int | float)]
    return [*alike, *alike, *alike, *FOREIGN]


@st.composite
def damaged_lines(draw: st.DrawFn) -> str:
    """Return the text of a run file in which one to three values are others, or missing."""
    lines = json.loads(json.dumps(LINES[draw(st.sampled_from(sorted(KINDS)))]))
    for _ in range(draw(st.integers(1, 3))):
        *path, key = draw(st.sampled_from(list(places(lines))))
        holder = lines
        for step in path:
            holder = holder[step]
        if isinstance(holder, dict) and draw(st.booleans()) and draw(st.booleans()):
            del holder[key]
        else:
            holder[key] = copy.deepcopy(draw(st.sampled_from(replacements(holder[key]))))
    return "".join(json.dumps(line) + "\n" for line in lines)


def check_ends_well(*words: str) -> None:
    """Run a command; it ends with a table, or with one line that says what is wrong."""
    done = CliRunner().invoke(cli, words)
    assert done.exit_code in (0, 1, 2), (done.exit_code, done.stderr)
    assert "unexpected" not in done.stderr, done.stderr
    assert "\x1b" not in done.output
    assert done.stderr.count("\n") <= 1, done.stderr
    assert done.output


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("runs")
    whole = [json.dumps(line) + "\n" for line in LINES["compare"]]
    (folder / "whole.jsonl").write_text("".join(whole))
    return folder


@settings(max_examples=150, deadline=None)
@given(text=damaged_lines())
def test_a_run_file_with_other_values_is_shown_or_refused(folder: Path, text: str) -> None:
    (folder / "damaged.jsonl").write_text(text)
    check_ends_well("show", str(folder / "damaged.jsonl"), "--json", str(folder / "out.json"))
    check_ends_well("show", str(folder / "damaged.jsonl"), str(folder / "whole.jsonl"))


@settings(max_examples=50, deadline=None)
@given(cut=st.floats(0, 1), at=st.floats(0, 1), inserted=st.binary(max_size=8))
def test_a_run_file_of_other_bytes_is_shown_or_refused(
    folder: Path, cut: float, at: float, inserted: bytes
) -> None:
    content = (folder / "whole.jsonl").read_bytes()
    place = int(at * len(content))
    content = content[:place] + inserted + content[place + len(inserted) :]
    (folder / "damaged.jsonl").write_bytes(content[: int(cut * len(content))])
    check_ends_well("show", str(folder / "damaged.jsonl"))


@pytest.mark.parametrize("command", KINDS)
def test_an_undamaged_run_file_is_shown(folder: Path, command: str) -> None:
    (folder / "sound.jsonl").write_text("".join(json.dumps(x) + "\n" for x in LINES[command]))
    assert CliRunner().invoke(cli, ["show", str(folder / "sound.jsonl")]).exit_code == 0
