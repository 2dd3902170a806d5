"""What to do about lines that samples show: a row for each remedy, with its two ways."""

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from mjbench.commands.lint import rules as lint_rules
from mjbench.commands.lint.check import Finding
from mjbench.commands.run.activities import Activity, Place
from mjbench.commands.run.loop_time import LineTime, LoopTime, error_of
from mjbench.commands.run.remedies import call_ways
from mjbench.commands.run.remedies.call_savings import Saving, count_of, steps_of
from mjbench.commands.run.remedies.remedy import Basis
from mjbench.commands.run.remedies.remedy_pairs import (
    MeasuredRatios,
    RemedyPair,
    TimedWay,
    TimeRatio,
)
from mjbench.commands.run.source_loops import loop_within_step
from mjbench.simulation import compat

# What a line calls, and the functions that only create an array.
_CALLED = re.compile(r"(\w+)\(")
_CREATE = {*lint_rules.ALLOCATIONS, "append", "asarray", "copy"}


def named_access(model: mujoco.MjModel, pair: RemedyPair) -> tuple[TimedWay, TimedWay]:
    names = [model.body(body).name for body in range(model.nbody)]
    body = next(name for name in reversed(names) if name)  # the world has one
    hoisted: list[Any] = []

    def before_the_loop(data: mujoco.MjData) -> Any:
        if not hoisted:  # all calls are of the same data
            hoisted.append(data.body(body))
        return hoisted[0].xpos[0]

    return TimedWay(lambda data: data.body(body).xpos[0]), TimedWay(before_the_loop)


def new_array(model: mujoco.MjModel, pair: RemedyPair) -> tuple[TimedWay, TimedWay]:
    permanent = np.zeros(model.nv)

    def write(data: mujoco.MjData) -> None:
        permanent[:] = 0.0

    return TimedWay(lambda data: np.zeros(model.nv)), TimedWay(write)


def concatenation(model: mujoco.MjModel, pair: RemedyPair) -> tuple[TimedWay, TimedWay]:
    nq = model.nq
    permanent = np.empty(nq + 2 * model.nv)
    after_velocities = nq + model.nv

    def write(data: mujoco.MjData) -> None:
        permanent[:nq] = data.qpos
        permanent[nq:after_velocities] = data.qvel
        permanent[after_velocities:] = data.qacc

    return TimedWay(lambda data: np.concatenate([data.qpos, data.qvel, data.qacc])), TimedWay(write)


def contacts(model: mujoco.MjModel, pair: RemedyPair) -> tuple[TimedWay, TimedWay]:
    return (
        TimedWay(lambda data: [contact.dist for contact in data.contact]),
        TimedWay(lambda data: data.contact.dist),
    )


def columns(model: mujoco.MjModel, pair: RemedyPair) -> tuple[TimedWay, TimedWay]:
    """Return the steps of finite differences, one for each column, and the one call for all."""
    size, state = 2 * model.nv + model.na, np.empty(compat.state_size(model))
    by_state, by_control = np.empty((size, size)), np.empty((size, model.nu))

    def by_steps(data: mujoco.MjData) -> None:
        compat.get_state(model, data, state)
        for _ in range(size + model.nu):
            compat.set_state(model, data, state)
            mujoco.mj_step(model, data)
        compat.set_state(model, data, state)

    def by_call(data: mujoco.MjData) -> None:
        mujoco.mjd_transitionFD(model, data, 1e-6, False, by_state, by_control, None, None)

    return TimedWay(by_steps), TimedWay(by_call)


@dataclass(frozen=True)
class LineRemedy:
    """How to measure what lint's rule `code` saves at a line that samples show."""

    line: re.Pattern[str]
    pair: RemedyPair
    code: str


# The first that fits counts.
LINE_REMEDIES = (
    LineRemedy(
        re.compile(""), RemedyPair(named_access, by_wall_time=True), lint_rules.NAMED_ACCESS
    ),
    LineRemedy(
        re.compile(r"\b(np|numpy)\.(concatenate|append|tile|[hv]?stack)\("),
        RemedyPair(concatenation),
        lint_rules.NEW_ARRAY,
    ),
    LineRemedy(re.compile(""), RemedyPair(new_array), lint_rules.NEW_ARRAY),
    LineRemedy(re.compile(r"\bin\b.*\.contact\b(?!\.)"), RemedyPair(contacts), "MJB019"),
)

# By code of lint: loops of which steps and Python go together, and their steps beside the call.
# Findings name that call.
LOOP_PAIRS = {
    "MJB006": RemedyPair(
        call_ways.rollouts,
        ("mj_step", "Rollout.rollout"),
        simulations=16,
        steps=25,
        on_threads=True,
    ),
    "MJB020": RemedyPair(columns),
}


def line_remedies(
    place: Place, findings: Sequence[Finding]
) -> Iterator[tuple[LineRemedy, Sequence[Finding]]]:
    """Yield what to do about a line, each with the findings that say so."""
    of_line = [
        each
        for each in findings
        if (each.file, each.line) == place.position and not each.is_wrong_result
    ]
    codes = set[str]()
    for remedy in LINE_REMEDIES:
        matching = [each for each in of_line if each.code == remedy.code]
        if matching and remedy.code not in codes and remedy.line.search(place.text):
            codes.add(remedy.code)
            yield remedy, matching


def has_row(finding: Finding, lines: Sequence[LineTime]) -> bool:
    """Return whether a row is about a finding at its own line, of lines that it is about."""
    texts = [line.place.text for line in lines if line.place.line == finding.line]
    return any(
        row.code == finding.code and row.line.search(text)
        for row in LINE_REMEDIES
        for text in texts
    )


def saved_with_steps(lines: Sequence[LineTime], ratio: TimeRatio | None, samples: int) -> Saving:
    """Return what one call saves in place of whole loops: their Python, and a part of the steps."""
    share = min(1.0, sum(line.share for line in lines))
    if ratio is None:
        return Saving(share, share, Basis.BOUND)
    steps = sum(line.activities.get(Activity.PHYSICS, 0.0) for line in lines)
    gain = share - steps * (1 - ratio.saved)
    error = math.hypot(error_of(gain, samples), steps * ratio.saved * ratio.relative_error)
    return Saving(gain, share, Basis.PAIRED, error / gain if gain else 0.0)


def saved(
    loop: LoopTime,
    line: LineTime,
    remedy: LineRemedy,
    count: int,
    share: float,
    measured: MeasuredRatios,
) -> Saving | None:
    """Return what is saved of a share of a line, by `count` findings in each step.

    Where a loop within a step runs the line, only its samples say how often it runs. They say
    nothing of an array that is a part of what the line computes: None.
    """
    text = line.place.text
    only_creates = " @ " not in text and set(_CALLED.findall(text)) <= _CREATE
    is_part = remedy.code == lint_rules.NEW_ARRAY and not only_creates
    ratio = measured.ratios.get(remedy.pair)
    nstep = count_of(steps_of(loop.calls))
    is_within = loop_within_step(line.place.position, loop.lines_to_step) is not None
    if ratio is not None and nstep and not is_within:
        gain = min(share, count * ratio.certainly_saved_s * nstep / loop.seconds)
    elif is_part:
        return None
    elif ratio is None:
        return Saving(share, share, Basis.BOUND)
    else:
        gain = share * ratio.saved
    return Saving(gain, share, Basis.PAIRED, ratio.relative_error)
