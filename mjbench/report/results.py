"""Results and advice, derived from a run's records; pure functions.

A speed is derived only for a measurement whose final states agree.
"""

import statistics
from collections.abc import Sequence
from typing import Any

from mjbench import stats
from mjbench.paths import BASE
from mjbench.runs import SCHEMA, Record

# Between paths this close to the fastest, advice prefers the one listed first: the simpler one.
CLOSE_ENOUGH = 0.99


def of_model(records: Sequence[Record]) -> list[Record]:
    """Return the results of one model's measurement records.

    Keys: model, path, options, status, detail, agrees, agreement, closed_loop, nbatch, nstep,
    hold, diverged, steps_per_s, step_ns (median, min), realtime_factor, speedup (median, low,
    high), work, rounds, snippet. What cannot be said is None.
    """
    head = next((r for r in records if r["type"] == "model"), {})
    rows = [r for r in records if r["type"] == "measurement"]
    base = next((r for r in rows if r["path"] == BASE and _timed(r)), None)
    timestep = head.get("facts", {}).get("timestep")
    return [_result(row, base, timestep) for row in rows]


def advice(results: Sequence[Record]) -> list[Record]:
    """Return what to use: the fastest path for open loop, and for closed loop.

    Only paths that were timed to the end stand for election: those that could not be the fastest
    were left out of the last rounds. Keys: model, loop, path, options, speedup, snippet.
    """
    found = []
    for model in dict.fromkeys(r["model"] for r in results):
        timed = [r for r in results if r["model"] == model and r["step_ns"]]
        for loop in ("open", "closed"):
            able = [r for r in timed if loop == "open" or r["closed_loop"]]
            if not able:
                continue
            longest = max(r["rounds"] for r in able)
            able = [r for r in able if r["rounds"] == longest]
            most = max(map(_rate, able))
            best = next(r for r in able if _rate(r) >= CLOSE_ENOUGH * most)
            found.append(
                {
                    "model": model,
                    "loop": loop,
                    "path": best["path"],
                    "options": best["options"],
                    "speedup": best["speedup"]["median"] if best["speedup"] else None,
                    "snippet": best["snippet"],
                }
            )
    return found


def document(machine: Record, results: Sequence[Record]) -> dict[str, Any]:
    """Return the one document that `--json` writes; docs/formats.md describes it."""
    return {
        "schema": SCHEMA,
        "machine": machine,
        "results": list(results),
        "advice": advice(results),
    }


def by_model(records: Sequence[Record]) -> list[list[Record]]:
    """Return a run's records model by model, in the order they were measured."""
    names = dict.fromkeys(r["model"] for r in records if "model" in r)
    return [[r for r in records if r.get("model") == name] for name in names]


def cores_had(head: Record) -> float | None:
    """Return the median of the cores that the calibration found, or None."""
    return statistics.median(head["cores_had"]) if head.get("cores_had") else None


def _rate(result: Record) -> float:
    """Return how fast a result is: paired with the base, where there is one."""
    return float(result["speedup"]["median"] if result["speedup"] else result["steps_per_s"])


def _timed(row: Record) -> bool:
    return bool(row["agrees"] and row["status"] == "ok" and row["samples_s"])


def _result(row: Record, base: Record | None, timestep: float | None) -> Record:
    result = {
        key: row[key]
        for key in ("model", "path", "options", "status", "detail", "agrees", "agreement")
    }
    result |= {key: row[key] for key in ("closed_loop", "nbatch", "nstep", "hold", "diverged")}
    result |= {"steps_per_s": None, "step_ns": None, "realtime_factor": None, "speedup": None}
    result |= {"work": row["work"], "rounds": len(row["samples_s"]), "snippet": row["snippet"]}
    if not _timed(row):
        return result
    steps, samples = row["nbatch"] * row["nstep"], row["samples_s"]
    median = statistics.median(samples) / steps
    result["steps_per_s"] = 1.0 / median
    result["step_ns"] = {"median": 1e9 * median, "min": 1e9 * min(samples) / steps}
    result["realtime_factor"] = timestep / median if timestep else None
    if base:
        n = min(len(base["samples_s"]), len(samples))
        estimate = stats.speedup(base["samples_s"][:n], samples[:n])
        result["speedup"] = {
            "median": estimate.median,
            "low": None if row is base else estimate.low,
            "high": None if row is base else estimate.high,
        }
    return result
