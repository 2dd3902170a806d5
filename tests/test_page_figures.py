"""Every figure in the prose of README and guides follows from a committed file or from the code.

A figure is a number with a unit, or a count of a count. `PHRASES` has the phrases in which figures
stand, page by page, each computed here. A figure outside them fails, and so does a phrase that its
page does not have.
"""

import json
import math
import re
import statistics
from collections.abc import Callable, Iterator

import method_figures
import numpy as np
import pytest
from commands import ROOT
from committed_trials import RUNS, trial_counts
from method_figures import percent
from test_docs import prose_of

from benchmarks.studies import foreign, foreign_page, foreign_tally, races, tuning, tuning_page
from benchmarks.studies.tally_file import load
from mjbench.commands.checkup import driver as checkup
from mjbench.commands.checkup import ranking
from mjbench.commands.compare import advice
from mjbench.commands.compare.options import CompareOptions
from mjbench.commands.doctor.options import DoctorOptions
from mjbench.commands.env.options import EnvironmentOptions
from mjbench.commands.latency.options import LatencyOptions
from mjbench.commands.profile.options import ProfileOptions
from mjbench.commands.record import capture
from mjbench.commands.run import show as program
from mjbench.commands.run.options import PROGRAM_S
from mjbench.commands.show import kinds, run_differences
from mjbench.commands.show.kinds import RECORD_TYPES
from mjbench.commands.tune import reference
from mjbench.commands.tune.options import TuneOptions
from mjbench.commands.versions import bisect
from mjbench.commands.versions.options import TargetOptions, VersionsOptions
from mjbench.counts import explain
from mjbench.paired import call_results, outcomes, race_record
from mjbench.results import runs
from mjbench.results.content import Section

FIGURE = re.compile(
    r"(?<![\w.,])\d[\d.,]*\s?"
    r"(?:%|×|times\b|ns\b|µs\b|ms\b|s\b|seconds?\b|minutes?\b|min\b|hours?\b|[KMG]i?B\b|Hz\b"
    r"|models?\b|releases?\b|programs?\b|MjData\b|states\b)"
    r"|\d+ of (?:the )?\d+"
)


def readme() -> Iterator[str]:
    machine = runs.load(RUNS / "reference-checkup-humanoid.jsonl", RECORD_TYPES).header.machine
    assert "AMD EPYC" in machine.cpu
    is_quiet = machine.load_1min < 0.5
    how = "otherwise idle" if is_quiet else f"a load of {machine.load_1min:.1f}"
    version = machine.versions["mujoco"]
    yield f"on two cores of our AMD EPYC with MuJoCo {version}"
    yield how
    page = (ROOT / "README.md").read_text()  # its block is compared with its run
    ((gain, low, high),) = re.findall(r"^humanoid: ([\d.]+) × as fast \((\S+)–(\S+)\)", page, re.M)
    yield f"step {gain} times as fast as in a plain Python loop"
    confidence = percent(race_record.CONFIDENCE)
    yield f"lies between {low} and {high} with {confidence} confidence"
    yield f"{trial_counts().alarms} comparisons without a slowdown"
    ours, others = (percent(1 - share) for share in decided_shares())
    yield f"{ours} of the advice on our models and {others} on others gets a `?`"
    yield "In 99 of 100 replays"
    yield f"the advised way is at most {percent(max(worst_regrets()), 1)} slower than the fastest"
    yield f"CPU results are from {common_machine()}"
    yield from durations()


def common_machine() -> str:
    """Return what all machines of committed run files have in common, but those with a GPU."""
    files = [file for file in ROOT.glob("results/*/*.jsonl") if "-gpu-" not in file.name]
    headers = (json.loads(file.read_text().partition("\n")[0])["machine"] for file in files)
    machines = {(each["system"].partition("-")[0], each["cores"]) for each in headers}
    assert machines == {("Linux", 2)}
    return "Linux with two cores"


def durations() -> Iterator[str]:
    """Yield the times of README's table: the default budgets, up to the next half minute."""
    for kind in (CompareOptions, EnvironmentOptions, VersionsOptions, TargetOptions, TuneOptions):
        seconds = 30 * math.ceil(kind.EACH_S / 30)
        takes = f"{seconds} s" if seconds < 60 else f"{seconds // 60} min"
        yield f"| {takes} |"
        if kind is CompareOptions:
            yield f"| {takes} and compiling |"
    yield f"| {PROGRAM_S:.0f} s |"
    yield f"| {checkup.TOTAL_S / 60:.0f} min |"
    for kind in (ProfileOptions, LatencyOptions):
        yield f"| {kind.EACH_S:.0f} s |"
    yield f"| {DoctorOptions.EACH_S:.0f} s |"


STUDIES = (races.SHIPPED, races.FOREIGN)


def worst_regrets() -> tuple[float, float]:
    """Return by how much the advised path is slower in 1 of 100 races: our models, others."""
    ours, others = (
        max(model.worst_regret for model in load(s.tally_file, races.RaceTally, "races").models)
        for s in STUDIES
    )
    return ours, others


def decided_shares() -> tuple[float, float]:
    """Return the share of replayed races that end certain: our models, others."""
    ours, others = (
        statistics.mean(m.decided for m in load(s.tally_file, races.RaceTally, "races").models)
        for s in STUDIES
    )
    return ours, others


def trust() -> Iterator[str]:
    counts = trial_counts()
    yield f"called different | {counts.alarms} |"
    yield f"slowdowns of about 1 % or more that were missed | {counts.missed} |"
    yield f"| {foreign_page.agreement(foreign_tally.load(foreign.TALLY))} |"
    ours, others = (percent(share) for share in decided_shares())
    yield f"the others end with a `?` | {ours} on our models, {others} on others |"
    yield "in the worst 1 % of replayed races"
    ours, others = worst_regrets()
    yield f"| {percent(ours, 1)} on our models, {percent(others, 1)} on others |"
    ours, others = (
        min(model.covered_final for model in load(s.tally_file, races.RaceTally, "races").models)
        for s in STUDIES
    )
    yield f"({percent(race_record.CONFIDENCE)} should)"
    yield f"| {percent(ours, 1)} on ours, {percent(others, 1)} on others |"
    yield from (f"| {kept} |" for kept in tuning_page.promises_kept(tuning.load()))
    yield f"The exit code is 1 if that is more than {percent(outcomes.MIN_EFFECT)}"
    yield f"can be faster by {percent(race_record.MARGIN)}"
    yield f"differs by more than {percent(run_differences.MIN_EFFECT)}"


def faster_as_a_whole(share: float, speedup: float) -> str:
    """Return how much faster a program is of which a share becomes faster."""
    return f"{1 / (1 - share + share / speedup):.2f}".rstrip("0") + " times as fast"


def story() -> Iterator[str]:
    stored = json.loads((ROOT / "results/story.json").read_text())
    before, after = (float(np.median(stored["steps_per_s"][n])) for n in ("walk_env", "walk_batch"))
    yield f"It runs {before:,.0f} steps of the environment a second"
    yield f"| `walk_env.py` | {before:,.0f} |"
    yield f"| `walk_batch.py` | {after:,.0f} |"
    yield f"That is {after / before:.1f} times as fast"
    page = (ROOT / "docs/guides/story.md").read_text()  # its blocks are compared with their runs
    (promised,) = re.findall(r"([\d.]+) times \([^)]*\) with Batch.step", page)
    yield f"had promised {promised} times"


def revisions() -> Iterator[str]:
    results = json.loads((ROOT / "results/revisions.json").read_text())
    slower, unchanged = (
        [result for result in results if result["is_slower"] == is_slower]
        for is_slower in (True, False)
    )
    assert len(slower) == 4
    assert {result["verdict"]["verdict"] for result in slower} == {"slower"}
    assert {result["verdict"]["verdict"] for result in unchanged} == {"same"}
    yield f"{len(unchanged)} changes of comments and docstrings were `same`"
    yield f"the smallest with {slower[0]['case']}"
    yield f"explains less than {percent(1 - bisect._REST)} of the difference"
    effect, confidence = percent(outcomes.MIN_EFFECT), percent(outcomes.CONFIDENCE)
    yield f"less than {effect} slower with {confidence} confidence"
    yield f"repeat within {percent(explain.REPEATABILITY, 1)}"
    yield f"arrays above {call_results._MOST_BYTES / 2**20:.0f} MiB"


def upgrades() -> Iterator[str]:
    yield f"at {percent(outcomes.CONFIDENCE)} confidence"
    yield f"which is at most {percent(outcomes.MIN_EFFECT)} (`--min-effect`)"
    yield f"repeat within {percent(explain.REPEATABILITY, 1)}"
    (releases,) = re.findall(r"^(\d+) releases, 2", (ROOT / "docs/history.md").read_text(), re.M)
    yield f"has ten typical models and {releases} releases"


def loop() -> Iterator[str]:
    yield f"for {PROGRAM_S:.0f} seconds"
    yield f"if it grew by {program._LEAST_GROWTH_BYTES / 2**20:.0f} MiB or more"


def checkup_guide() -> Iterator[str]:
    yield f"or {checkup.QUICK_S:.0f} seconds with `--quick`"
    yield f"for {PROGRAM_S:.0f} seconds"
    yield f"whose error exceeds {percent(ranking._MOST_ERROR)} of the motion"


def environments() -> Iterator[str]:
    run = runs.load(RUNS / "reference-environments.jsonl", RECORD_TYPES)
    yield f"with MuJoCo {run.header.machine.versions['mujoco']}"
    for section in kinds.kind_of(run).sections(run):
        shares, same_physics = _first_lines(section)
        speedups = re.findall(r"([\d.]+) times", same_physics)
        yield f"| {shares} | {speedups[0]} | {speedups[-1]} |"


def _first_lines(section: Section) -> tuple[str, str]:
    """Return the share of physics, and the sentence on the same physics without an environment."""
    texts = [conclusion.text for conclusion in section.conclusions]
    (share,) = re.findall(r"(\d+ %) of env.step is physics", " ".join(texts))
    (same_physics,) = [text for text in texts if "The same physics runs" in text]
    return share, same_physics


PHRASES: dict[str, Callable[[], Iterator[str]]] = {
    "README.md": readme,
    "docs/faq.md": lambda: iter(
        (f"trust only differences above {percent(run_differences.MIN_EFFECT)}",)
    ),
    "docs/guides/checkup.md": checkup_guide,
    "docs/guides/environments.md": environments,
    "docs/guides/loop.md": loop,
    "docs/guides/machines.md": lambda: iter(
        (f"of those named slower, at most {percent(1 - outcomes.CONFIDENCE)} are expected",)
    ),
    "docs/guides/revisions.md": revisions,
    "docs/guides/settings.md": lambda: iter(
        (
            f"by at most {percent(reference.SAME_SHARE, 3)} of the motion",
            faster_as_a_whole(share=1 / 3, speedup=2),
        )
    ),
    "docs/guides/states.md": lambda: iter(
        (
            f"at most `max_states` states ({capture.MAX_STATES:,})",
            f"`nstep` consecutive steps ({capture.WINDOW_NSTEP:,})",
        )
    ),
    "docs/guides/stepping.md": lambda: iter((f"that has {percent(advice.ENOUGH)} of the best",)),
    "docs/guides/story.md": story,
    "docs/guides/trust.md": trust,
    "docs/guides/upgrades.md": upgrades,
}
PHRASES |= method_figures.PHRASES
PAGES = sorted({*PHRASES, *(str(p.relative_to(ROOT)) for p in ROOT.glob("docs/guides/*.md"))})


@pytest.mark.parametrize("page", PAGES)
def test_every_figure_of_a_page_is_of_a_committed_file_or_of_the_code(page: str) -> None:
    text = " ".join((ROOT / page).read_text().split())
    rest = " ".join(prose_of(ROOT / page).split())
    for phrase in PHRASES.get(page, lambda: iter(()))():
        assert phrase in text
        rest = rest.replace(" ".join(re.sub(r"`[^`]+`", "", phrase).split()), "")
    assert FIGURE.findall(rest) == []


def test_a_figure_is_found_with_its_unit_and_without_a_phrase() -> None:
    text = "1.9 times as fast, 0.5 %, 1 of 953, 15 s, 2 GiB, 3 of the 240, 42 releases; MuJoCo 3.17"
    found = ["1.9 times", "0.5 %", "1 of 953", "15 s", "2 GiB", "3 of the 240", "42 releases"]
    assert FIGURE.findall(text) == found
