"""Why is a release slower: instructions by function and stage, old against new."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from mjbench.counts.instructions import Count
from mjbench.paired.verdict import PairedResult
from mjbench.simulation import agreement

# Two counts of the same work differ by less (tests/test_instructions.py).
REPEATS = 0.001
# Where the clock and the instructions disagree by more than this, something else is at work.
DISAGREEMENT = 0.03


@dataclass(frozen=True)
class Change:
    """A function, in both releases.

    Attributes:
      name: of the function.
      old: instructions per step of the function itself; None where it does not occur.
      new: the same in the new release.
    """

    name: str
    old: float | None
    new: float | None

    @property
    def difference(self) -> float:
        """Return new less old, per step."""
        return (self.new or 0.0) - (self.old or 0.0)

    @property
    def kind(self) -> str:
        """Return `new`, `gone`, or nothing."""
        return "new" if self.old is None else "gone" if self.new is None else ""


def changes(old: Count, new: Count) -> list[Change]:
    """Return all functions that differ, the largest contribution first."""
    before = {f.name: f.self for f in old.functions if f.self}
    after = {f.name: f.self for f in new.functions if f.self}
    found = [Change(name, before.get(name), after.get(name)) for name in {**before, **after}]
    found = [change for change in found if change.difference]
    return sorted(found, key=lambda c: (-abs(c.difference), c.name))


def sentence(old: Count, new: Count, outcome: PairedResult | None) -> list[str]:
    """Return what changed, in lines: code, work, or the clock alone."""
    assert old.instructions_per_step and new.instructions_per_step
    ratio = new.instructions_per_step / old.instructions_per_step
    lines = [
        f"instructions per step {old.instructions_per_step:,.0f} → {new.instructions_per_step:,.0f}"
        f" ({100 * (ratio - 1):+.2f} %)"
    ]
    work = agreement.work_changes(
        old.work or {}, new.work or {}, drift(old, new), (old.diverged, new.diverged)
    )
    lines.append("changed work: " + ", ".join(work) if work else "same work")
    judged = outcome.judgement if outcome else None
    if outcome and outcome.status != "ok":
        lines.append(f"time not compared: {outcome.detail}")
    if judged is None:
        return lines
    lines.append(
        f"time {100 * (judged.ratio - 1):+.2f} % ({100 * (judged.low - 1):+.2f} to"
        f" {100 * (judged.high - 1):+.2f}), {judged.verdict}"
    )
    apart = abs(judged.ratio - ratio)
    certain = not judged.low - DISAGREEMENT <= ratio <= judged.high + DISAGREEMENT
    if apart > DISAGREEMENT and certain:
        lines.append(
            f"time and instructions disagree by {100 * apart:.1f} points: what instructions do not"
            " see are cache misses, mispredicted branches, wider or slower instructions (SIMD,"
            " division), memory allocation in the kernel, and system calls"
        )
    return lines


def as_result(old: Count, new: Count, outcome: PairedResult | None) -> dict[str, Any]:
    """Return what `mjbench explain --json` gives of one model."""
    return {
        "model": new.model,
        "old": old.release,
        "new": new.release,
        "status": next((c.status for c in (old, new) if c.status != "ok"), "ok"),
        "instructions_per_step": {
            "old": old.instructions_per_step,
            "new": new.instructions_per_step,
        },
        "outside_per_step": {"old": old.outside_per_step, "new": new.outside_per_step},
        "work": {"old": old.work, "new": new.work},
        "stages": _stages(old, new),
        "functions": [
            {"name": c.name, "old": c.old, "new": c.new, "difference": c.difference}
            for c in changes(old, new)
        ],
        "time": outcome.row() if outcome else None,
    }


def _stages(old: Count, new: Count) -> dict[str, dict[str, float]]:
    before, after = old.stages or {}, new.stages or {}
    return {
        stage: {"old": before.get(stage, 0.0), "new": after.get(stage, 0.0)}
        for stage in {**before, **after}
    }


def verdict(old: Count, new: Count, min_effect: float) -> dict[str, Any]:
    """Return what `mjbench versions --metric instructions --json` gives of one model.

    It has the keys of a verdict on time. The interval is what two counts may differ by.
    """
    failed = next((count for count in (old, new) if count.status != "ok"), None)
    ratio = None
    if not failed and old.instructions_per_step and new.instructions_per_step:
        ratio = new.instructions_per_step / old.instructions_per_step
    work = None if failed else {"old": dict(old.work or {}), "new": dict(new.work or {})}
    side = {"path": "python_loop", "options": {}, "model_options": {}, "slowdown": 0.0}
    notes = [f"MuJoCo {c.release}: {c.detail}" for c in (old, new) if c.detail]
    moved, diverged = drift(old, new), (old.diverged, new.diverged)
    return {
        "model": new.model,
        "path": "python_loop",
        "metric": "instructions",
        "old": old.release,
        "new": new.release,
        "sides": [{"release": c.release, "model": c.model, **side} for c in (old, new)],
        "status": failed.status if failed else "ok",
        "detail": "; ".join(notes),
        "verdict": ratio and _verdict(ratio, min_effect),
        "ratio": ratio
        and {"estimate": ratio, "low": ratio / (1 + REPEATS), "high": ratio * (1 + REPEATS)},
        "changed_work": work
        and bool(agreement.work_changes(work["old"], work["new"], moved, diverged)),
        "work": work,
        "drift": moved,
        "diverged": {"old": old.diverged, "new": new.diverged},
        "nbatch": None,
        "nstep": None,
        "launches": 0,
        "pairs": 0,
        "seconds": new.seconds + old.seconds,
    }


def drift(old: Count, new: Count) -> float | None:
    """Return how far one step leads apart from the same states, in SI units; None if unknown."""
    if old.after is None or new.after is None:
        return None
    before, after = ({k: np.array(v) for k, v in c.after.items()} for c in (old, new) if c.after)
    return agreement.drift(after, before)


def _verdict(ratio: float, min_effect: float) -> str:
    if ratio >= 1 + min_effect:
        return "slower"
    return "faster" if ratio <= 1 / (1 + min_effect) else "same"
