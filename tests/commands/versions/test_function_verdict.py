"""Verdicts on functions of the user's code; nothing is started, and launches are invented."""

import math
import random
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from paired_examples import InventedPair

from mjbench.commands.versions import family, function_verdict
from mjbench.commands.versions.function_sides import FunctionTarget, FunctionTargets, OtherCodeError
from mjbench.commands.versions.function_verdict import CallPlan, FunctionPair
from mjbench.errors import InputError, MachineError, UnavailableError
from mjbench.paired.call_results import Leaf
from mjbench.paired.outcomes import ResultsOutcome, Verdict
from mjbench.paired.records import LaunchRow, VerdictRecord
from mjbench.paired.time_limit import OutOfTimeError, TimeLimit
from mjbench.paired.timed_function import CodeOrigin, FunctionFacts, FunctionSource
from mjbench.paired.verdict import VerdictPlan
from mjbench.paired.worker_pool import WorkerPool
from mjbench.releases.pip import BuildError
from mjbench.releases.release_names import ReleaseSpec
from mjbench.releases.revisions import Revision
from mjbench.status import ExitCode, Status

BASELINE = FunctionTarget(
    "bench.py::step",
    Revision("main", "a" * 40),
    "tree of main",
    FunctionSource("step", "bench", "bench.py", b""),
    CodeOrigin(frozenset(), (), ""),
    ReleaseSpec("installed", "4.0.0"),
)
CANDIDATE = replace(BASELINE, revision=Revision("HEAD", "b" * 40), tree="tree of HEAD")
FACTS = FunctionFacts(
    [[Leaf("", np.array(1.0))]] * 3, "", 10, 1e-4, 1.0, "", {"Python": "3.11", "mujoco": "4.0.0"}
)
OTHER = replace(FACTS, results=[[Leaf("", np.array(2.0))]] * 3)
Observed = FunctionFacts | BaseException


@dataclass
class Invented:
    """What observations and launches are to give.

    Attributes:
      observed: of each side, one after the other; the last one again and again.
      log_ratio: of launches of both sides.
      slowing: how much longer the last quarter of a launch takes.
      control: of the baseline with itself.
      launch_s: seconds that a launch takes.
      control_s: that one of the control takes, where it takes less.
      control_end: what is raised where the control's processes are ended.
      targets: the two sides.
    """

    observed: dict[str, list[Observed]]
    log_ratio: float = 0.0
    slowing: float = 1.0
    control: float = 0.0
    launch_s: float = 0.5
    control_s: float = math.inf
    control_end: BaseException | None = None
    targets: FunctionTargets = (BASELINE, CANDIDATE)


Decided = Callable[[Invented], VerdictRecord]


@pytest.fixture
def decided(monkeypatch: pytest.MonkeyPatch) -> Decided:
    """Return what decides between the baseline and the candidate."""

    def decide(invented: Invented) -> VerdictRecord:
        clock, rng = [0.0], random.Random(3)

        def observe(pool: Any, target: FunctionTarget, role: str) -> FunctionFacts:
            observed = invented.observed[role]
            facts = observed.pop(0) if len(observed) > 1 else observed[0]
            if isinstance(facts, BaseException):
                raise facts
            return facts

        def pair(pool: Any, targets: Any, plan: CallPlan, limit: TimeLimit) -> InventedPair:
            is_control = targets[0] is targets[1]
            mean = invented.control if is_control else invented.log_ratio
            launch_s = min(invented.launch_s, invented.control_s if is_control else math.inf)

            def invent() -> LaunchRow:
                clock[0] += launch_s
                ratio = np.exp(rng.gauss(mean, 0.002))
                ns = [1_000_000, int(1_000_000 * ratio), int(1_000_000 * ratio), 1_000_000]
                later = [round(invented.slowing * block) for block in ns]
                return LaunchRow(0, None, ["ABBA"] * 4, [ns, ns, ns, later])

            invented_pair = InventedPair(limit, invent)

            def close() -> None:
                if is_control and invented.control_end is not None:
                    raise invented.control_end

            monkeypatch.setattr(invented_pair, "close", close)
            return invented_pair

        monkeypatch.setattr(function_verdict, "observe", observe)
        monkeypatch.setattr(function_verdict, "FunctionPair", pair)
        pool: Any = None
        plan = VerdictPlan()
        return function_verdict.decide_function(
            pool, invented.targets, plan, clock=lambda: clock[0]
        )

    return decide


def sides(baseline: Observed, candidate: Observed, again: Observed | None = None) -> Any:
    """Return what is observed of both; of the baseline's second process, `again`."""
    return {"baseline": [baseline, again or baseline], "candidate": [candidate]}


@pytest.mark.parametrize(
    ("log_ratio", "verdict"), [(0.0, Verdict.SAME), (0.05, Verdict.SLOWER), (-0.05, Verdict.FASTER)]
)
def test_launches_decide(decided: Decided, log_ratio: float, verdict: Verdict) -> None:
    record = decided(Invented(sides(FACTS, FACTS), log_ratio))
    assert (record.status, record.verdict) == (Status.OK, verdict)
    assert record.results == ResultsOutcome.SAME
    assert record.changed_work is False
    assert (record.old, record.new) == ("main", "HEAD")
    assert record.ratio is not None
    assert record.ratio.covers(np.exp(log_ratio))


def test_calls_that_take_longer_and_longer_are_recorded(decided: Decided) -> None:
    assert decided(Invented(sides(FACTS, FACTS))).slowing == pytest.approx(1.0)
    record = decided(Invented(sides(FACTS, FACTS), slowing=3.0))
    assert record.slowing == pytest.approx(3.0, rel=0.02)
    assert record.verdict == Verdict.SAME


def test_the_control_stands_beside_the_verdict(decided: Decided) -> None:
    record = decided(Invented(sides(FACTS, FACTS), 0.05))
    assert record.control is not None
    assert record.control.covers
    assert record.control.launches == 8


def test_a_control_that_shows_a_difference_leaves_all_undecided(decided: Decided) -> None:
    record = decided(Invented(sides(FACTS, FACTS), 0.05, control=0.03))
    assert record.control is not None
    assert not record.control.covers
    assert record.verdict == Verdict.INCONCLUSIVE
    assert record.detail == "the baseline differs from itself"
    assert family.adjust_for_family([record], 0.99).slower == []


def test_other_results_get_no_verdict_on_speed(decided: Decided) -> None:
    record = decided(Invented(sides(FACTS, OTHER), 0.05))
    assert (record.status, record.verdict, record.ratio) == (Status.DISAGREES, None, None)
    assert record.changed_work is True
    assert "call 1 returns 2.0 instead of 1.0; no verdict on speed" in record.detail


def test_random_results_are_not_compared(decided: Decided) -> None:
    record = decided(Invented(sides(FACTS, OTHER, again=OTHER), 0.05))
    assert (record.results, record.changed_work) == (ResultsOutcome.RANDOM, None)
    assert record.verdict == Verdict.SLOWER


def test_results_that_cannot_be_compared_say_why(decided: Decided) -> None:
    unknown = replace(FACTS, results=[], problem="TypeError: Robot is no number")
    record = decided(Invented(sides(unknown, unknown)))
    assert (record.results, record.changed_work) == (ResultsOutcome.NONE, None)
    assert record.results_detail == "TypeError: Robot is no number"


def test_what_the_baseline_lacks_is_new(decided: Decided) -> None:
    record = decided(Invented(sides(UnavailableError("baseline: bench has no step"), FACTS)))
    assert (record.status, record.verdict) == (Status.NEW, None)
    assert record.detail == "new, so not compared: baseline: bench has no step"


def test_what_only_the_baseline_can_do_is_a_failure(decided: Decided) -> None:
    record = decided(Invented(sides(FACTS, UnavailableError("candidate: it raises"))))
    assert (record.status, record.detail) == (Status.FAILED, "candidate: it raises")


def test_what_neither_can_do_is_an_error_of_the_input(decided: Decided) -> None:
    error = UnavailableError("bench has no step")
    assert decided(Invented(sides(error, error))).status == Status.INPUT


@pytest.mark.parametrize(
    ("error", "status"),
    [(MachineError("it crashed"), Status.FAILED), (KeyboardInterrupt(), Status.INTERRUPTED)],
)
def test_what_ends_an_observation_or_a_control_is_recorded(
    decided: Decided, error: Any, status: Status
) -> None:
    assert decided(Invented(sides(error, FACTS))).status == status
    record = decided(Invented(sides(FACTS, FACTS), control_end=error))
    assert (record.status, record.verdict) == (status, None)
    assert record.launches == 0


@pytest.mark.parametrize(
    ("candidate", "message"),
    [
        (replace(FACTS, misplaced="own from /checkout/own.py"), "imported own from /checkout"),
        (replace(FACTS, versions={"mujoco": "3.3.0"}), "ran on mujoco 4.0.0, the candidate on 3"),
    ],
)
def test_other_code_is_never_timed(
    decided: Decided, candidate: FunctionFacts, message: str
) -> None:
    with pytest.raises(OtherCodeError, match=message) as raised:
        decided(Invented(sides(FACTS, candidate)))
    assert raised.value.exit_code == ExitCode.OTHER_CODE


def test_what_cannot_be_installed_ends_all(decided: Decided) -> None:
    with pytest.raises(BuildError, match="cannot install own"):
        decided(Invented(sides(BuildError("cannot install own.whl"), FACTS)))


def test_a_launch_that_exceeds_the_limit_ends_as_inconclusive(decided: Decided) -> None:
    record = decided(Invented(sides(FACTS, FACTS), launch_s=20.0))
    assert (record.status, record.verdict) == (Status.OK, Verdict.INCONCLUSIVE)
    assert "a verdict with its control needs at least 16 launches, 400 s in all" in (record.detail)
    assert record.launches == 0


def test_a_budget_is_for_the_control_as_well(decided: Decided) -> None:
    record = decided(Invented(sides(FACTS, FACTS), launch_s=20.0, control_s=1.0))
    assert record.control is not None
    assert "a verdict with its control needs at least 16 launches, 400 s in all" in (record.detail)


def test_revisions_with_the_same_files_are_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    pool: Any = None
    monkeypatch.setattr(function_verdict, "observe", lambda *_: FACTS)
    targets = BASELINE, replace(CANDIDATE, tree=BASELINE.tree)
    record = function_verdict.decide_function(pool, targets, VerdictPlan())
    assert (record.verdict, record.ratio) == (Verdict.SAME, None)
    assert "the same files" in record.detail


def test_a_function_that_the_same_files_lack_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    def observe(*_: object) -> None:
        raise UnavailableError("bench.py has no nosuch, but it has step")

    monkeypatch.setattr(function_verdict, "observe", observe)
    pool: Any = None
    targets = BASELINE, replace(CANDIDATE, tree=BASELINE.tree)
    record = function_verdict.decide_function(pool, targets, VerdictPlan())
    assert (record.status, record.verdict) == (Status.INPUT, None)
    assert record.detail == "bench.py has no nosuch, but it has step"


@pytest.mark.parametrize(("cores", "nthread_is_one"), [(1.0, True), (1.9, False)])
def test_a_function_with_threads_gets_all_cores(cores: float, nthread_is_one: bool) -> None:
    plan = CallPlan.of([replace(FACTS, calls=7), replace(FACTS, cores=cores)])
    assert plan.count == 7
    assert (plan.nthread == 1) is (nthread_is_one or plan.nthread == 1)


def test_calls_that_are_too_slow_are_refused_before_the_first_block() -> None:
    slow = replace(FACTS, calls=1, call_s=20.0)
    with WorkerPool() as pool:
        plan, limit = CallPlan.of([slow, slow]), TimeLimit(60.0, 16)
        with pytest.raises(
            OutOfTimeError, match=r"needs at least 16 launches, .* give a longer --budget"
        ):
            FunctionPair(pool, (BASELINE, CANDIDATE), plan, limit).fix_work()


def test_an_argument_that_only_the_baseline_takes_is_new(decided: Decided) -> None:
    record = decided(Invented(sides(InputError("step takes model"), FACTS)))
    assert record.status == Status.NEW


def test_environments_differ_in_the_versions_of_packages(decided: Decided) -> None:
    baseline, candidate = (
        replace(
            BASELINE,
            revision=None,
            tree="",
            release=ReleaseSpec(name, "4.0.0", requirements=(name,), has_packages=True),
        )
        for name in ("numpy==2.3.5", "numpy==2.4.0")
    )
    other = replace(FACTS, versions={**FACTS.versions, "numpy": "2.4.0"})
    invented = Invented(sides(FACTS, other), 0.05, targets=(baseline, candidate))
    record = decided(invented)
    assert record.verdict == Verdict.SLOWER
    assert (record.old, record.new) == ("numpy==2.3.5", "numpy==2.4.0")


def test_one_environment_is_not_compared_with_itself(decided: Decided) -> None:
    target = replace(BASELINE, revision=None, tree="")
    record = decided(Invented(sides(FACTS, FACTS), 0.05, targets=(target, target)))
    assert (record.verdict, record.launches) == (Verdict.SAME, 0)
    assert record.detail == "both environments are one, so nothing was timed"
