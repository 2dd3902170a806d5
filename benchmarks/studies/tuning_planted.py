"""Does `mjbench tune` find what was planted in a model, and nothing where nothing was?

    python -m benchmarks.studies.tuning_planted [CASE …] [--budget SECONDS]

searches settings for models that have a needless cost each: a tiny timestep, 200 pairs of bodies
that never touch, a dense Jacobian, RK4 where Euler's method errs as little. In each, the knob that
removes the cost must be among the recommended settings; in a model without any of the four, none of
their knobs may be, nor in one whose solver stops at its limit of iterations. It takes about a
minute and a half a model.

The exit code is 1 if one is missing, or one too many, and 0 otherwise.
"""

import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from benchmarks.studies import tally_command
from mjbench.errors import one_line
from mjbench.paired.worker_pool import WorkerPool
from mjbench.simulation.models import ModelSource
from mjbench.status import ExitCode, Status
from mjbench.tuning.records import TuneRecord
from mjbench.tuning.search_plan import SearchPlan
from mjbench.tuning.settings import label

BUDGET_S = 120.0
# The knobs that can remove a planted cost.
PLANTED = ("timestep", "excludes", "jacobian", "integrator")


@dataclass(frozen=True)
class Case:
    """A model, and the cost that was planted.

    Attributes:
      knob: knob that removes the cost; empty where there is none.
    """

    name: str
    xml: str
    knob: str = ""


def chain(count: int, options: str) -> str:
    """Return a swinging, damped chain of some links."""
    links = "".join(
        f"<body pos='0 0 {-0.2 if i else 0}'><joint axis='0 1 0' damping='.02'/>"
        "<geom type='capsule' fromto='0 0 0 0 0 -.2' size='.02' contype='0' conaffinity='0'/>"
        for i in range(count)
    )
    return (
        f"<mujoco><option {options}/><worldbody>{links}{'</body>' * count}</worldbody>"
        f"<keyframe><key qpos='{' '.join(['.2'] * count)}'/></keyframe></mujoco>"
    )


def rods(na: int, nb: int, options: str = "") -> str:
    """Return rods that spin about themselves, side by side; only `a` may collide with `b`.

    Each is near every other, and touches none.
    """
    rod = (
        "<body name='{kind}{index}' pos='0 {y} 0' euler='0 0 45'><joint axis='1 0 0'/>"
        "<geom type='capsule' size='.01' fromto='0 0 0 3 0 0' contype='{own}'"
        " conaffinity='{other}'/></body>"
    )
    a = (rod.format(kind="a", index=i, y=-0.05 * i, own=1, other=2) for i in range(na))
    b = (rod.format(kind="b", index=i, y=0.05 * (i + 1), own=2, other=1) for i in range(nb))
    return f"<mujoco><option {options}/><worldbody>{''.join(a)}{''.join(b)}</worldbody></mujoco>"


def boxes(count: int, options: str, joint: str = "<freejoint/>") -> str:
    """Return boxes that rest on a plane."""
    bodies = "".join(
        f"<body pos='{0.5 * (i % 6)} {0.5 * (i // 6)} .1'>{joint}"
        "<geom type='box' size='.1 .1 .1'/></body>"
        for i in range(count)
    )
    return (
        f"<mujoco><option {options}/><worldbody><geom type='plane' size='5 5 1'/>{bodies}"
        "</worldbody></mujoco>"
    )


def stack(count: int, options: str) -> str:
    """Return boxes on top of each other, the topmost ten times as heavy."""
    bodies = "".join(
        f"<body pos='0 0 {0.05 + 0.1 * i}'><freejoint/><geom type='box' size='.05 .05 .05'"
        f" mass='{10 if i == count - 1 else 1}'/></body>"
        for i in range(count)
    )
    return (
        f"<mujoco><option {options}/><worldbody><geom type='plane' size='5 5 1'/>{bodies}"
        "</worldbody></mujoco>"
    )


SLIDE = "<joint type='slide' axis='0 0 1'/>"

CASES = (
    Case("tiny timestep", chain(4, "timestep='0.0001'"), "timestep"),
    Case("200 idle pairs", rods(10, 20, "timestep='0.002'"), "excludes"),
    Case("dense Jacobian", boxes(24, "timestep='0.002' jacobian='dense'"), "jacobian"),
    Case("RK4", boxes(6, "timestep='0.002' integrator='RK4'", SLIDE), "integrator"),
    Case("nothing planted", chain(4, "timestep='0.004'")),
    Case("solver at its limit", stack(10, "solver='PGS' iterations='10'")),
)


def search(case: Case, budget_s: float) -> TuneRecord:
    """Return what a search on a case comes to."""
    from mjbench.api.tune import tune

    with tempfile.TemporaryDirectory() as folder, WorkerPool() as pool:
        file = Path(folder) / "planted.xml"
        file.write_text(case.xml)
        return tune(pool, ModelSource(case.name, file), SearchPlan(budget_s=budget_s))


def problem(case: Case, record: TuneRecord) -> str:
    """Return what is wrong with a search, in one line; empty where it is as it must be."""
    if record.status != Status.OK:
        return f"{record.status}: {one_line(record.detail)}"
    best = record.best()
    chosen = {each.knob for each in best.settings} if best else set()
    if case.knob and case.knob not in chosen:
        return f"does not recommend {case.knob}"
    more = sorted(chosen.intersection(PLANTED)) if not case.knob else []
    return f"recommends {', '.join(more)}, which was not planted" if more else ""


def main(arguments: Sequence[str] | None = None) -> ExitCode:
    """Run the command; return its exit code."""
    parser = tally_command.parser(__doc__)
    parser.add_argument("cases", nargs="*", metavar="CASE")
    parser.add_argument("--budget", type=float, default=BUDGET_S, help="seconds of each search")
    options = parser.parse_args(arguments)
    unknown = set(options.cases).difference(case.name for case in CASES)
    if unknown:
        parser.error(f"no case {', '.join(sorted(unknown))}")
    wrong = 0
    for case in CASES:
        if options.cases and case.name not in options.cases:
            continue
        record = search(case, options.budget)
        best, of_case = record.best(), problem(case, record)
        settings = (
            f"{1 / best.ratio.estimate:.2f}×: {label(best.settings)}"
            if best
            else "nothing is faster"
        )
        print(f"{case.name}: {settings}{f'; WRONG: {of_case}' if of_case else ''}", flush=True)
        wrong += bool(of_case)
    return ExitCode.FINDING if wrong else ExitCode.OK


if __name__ == "__main__":
    sys.exit(main())
