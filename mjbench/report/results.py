"""Results and advice, derived from a run's records; pure functions.

A speed is derived only for a measurement whose final states agree.
"""

import statistics
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from mjbench.errors import InputError
from mjbench.instrument import stats
from mjbench.instrument.runs import SCHEMA, Record
from mjbench.paths import BASE

# Between paths this close to the fastest, advice prefers the one listed first: the simpler one.
CLOSE_ENOUGH = 0.99
# What must not differ where something was compiled: what compiled it, and with which flags.
_COMPILERS = ("jax", "jaxlib", "warp-lang")
_COMPILER_FLAGS = ("XLA_FLAGS", "JAX_DEFAULT_MATMUL_PRECISION", "NVIDIA_TF32_OVERRIDE")
# What is told of a path that compiles.
COMPILED = (
    "precision",
    "device",
    "trace_s",
    "compile_s",
    "memory_bytes",
    "gpu_memory_bytes",
    "check",
)


def of_model(records: Sequence[Record]) -> list[Record]:
    """Return the results of one model's measurement records.

    Keys: model, path, options, status, detail, agrees, agreement, closed_loop, nbatch, nstep,
    hold, diverged, steps_per_s, step_ns (median, min), realtime_factor, speedup (median, low,
    high), work, rounds, snippet, nbatch_asked; for a path that compiles also precision, device,
    trace_s, compile_s, memory_bytes, gpu_memory_bytes, check and overtakes_after_steps (steps of
    the plain loop after which its own compilation is made up for). What cannot be said is None.
    """
    head = next((r for r in records if r["type"] == "model"), {})
    rows = [r for r in records if r["type"] == "measurement"]
    base = next((r for r in rows if r["path"] == BASE and _timed(r)), None)
    timestep = head.get("facts", {}).get("timestep")
    return [_result(row, base, timestep) for row in rows]


def advice(results: Sequence[Record]) -> list[Record]:
    """Return what to use: the fastest path for open loop, and for closed loop.

    Paths whose steps could not be judged do not stand for election (see `judged`).
    Only paths that were timed to the end stand for election: those that could not be the fastest
    were left out of the last rounds. Keys: model, nbatch, loop, path, options, speedup, snippet.
    """
    found = []
    for key in dict.fromkeys(map(group, results)):
        model = key[0]
        timed = [r for r in results if group(r) == key and r["step_ns"] and judged(r)]
        for loop in ("open", "closed"):
            able = [r for r in timed if loop == "open" or r["closed_loop"]]
            if not able:
                continue
            longest = max((r["rounds"] for r in able if not _compiles(r)), default=0)
            able = [r for r in able if _compiles(r) or r["rounds"] == longest]
            most = max(map(_rate, able))
            best = next(r for r in able if _rate(r) >= CLOSE_ENOUGH * most)
            found.append(
                {
                    "model": model,
                    "nbatch": best["nbatch"],
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
        "crossovers": crossovers(results),
    }


def by_model(records: Sequence[Record]) -> list[list[Record]]:
    """Return a run's records model by model, in the order they were measured."""
    keys = dict.fromkeys(group(r) for r in records if "model" in r)
    return [[r for r in records if "model" in r and group(r) == key] for key in keys]


def group(row: Record) -> tuple[str, int | None]:
    """Return what a row is compared within: a model, at one of the sizes asked for."""
    return row["model"], row.get("nbatch_asked")


def crossovers(results: Sequence[Record]) -> list[Record]:
    """Return from which number of simulations on each compiled path overtakes the best C path.

    Of the sizes that were measured and judged: the least from which on it is faster at every one.
    Keys: model, path, options, nbatch (None: at none), largest (size at which both were timed),
    rival (path and options of the best C path there), share (of the rival's speed, at the largest).
    """
    found = []
    for model in dict.fromkeys(r["model"] for r in results):
        timed = [r for r in results if r["model"] == model and r["steps_per_s"] and judged(r)]
        best: dict[int, Record] = {}
        for row in timed:
            size = row["nbatch_asked"]
            faster = size not in best or row["steps_per_s"] > best[size]["steps_per_s"]
            if size and not _compiles(row) and faster:
                best[size] = row
        variants = [(r["path"], r["options"]) for r in timed if _compiles(r)]
        for path, options in [v for i, v in enumerate(variants) if v not in variants[:i]]:
            own = {
                r["nbatch_asked"]: r["steps_per_s"] / best[r["nbatch_asked"]]["steps_per_s"]
                for r in timed
                if (r["path"], r["options"]) == (path, options) and r["nbatch_asked"] in best
            }
            if len(own) < 2:
                continue
            largest, ahead = max(own), None
            for size in sorted(best, reverse=True):
                if own.get(size, 0) <= 1:  # slower there, or it failed
                    break
                ahead = size
            rival = {key: best[largest][key] for key in ("path", "options")}
            found.append(
                {
                    "model": model,
                    "path": path,
                    "options": options,
                    "nbatch": ahead,
                    "largest": largest,
                    "rival": rival,
                    "share": own[largest],
                }
            )
    return found


def differences(old: Sequence[Record], new: Sequence[Record], across: bool) -> list[Record]:
    """Return how the measurements of one run file compare with those of another.

    Args:
      old: records, the header first.
      new: the same of the other file.
      across: compare also what differs in identity.

    Returns:
      For every row of both that was timed: model, path, options, nbatch, status (`ok`, or `input`
      where they cannot be compared), detail, ratio (estimate, low, high; new time over old).
    """
    before = {_row_key(r): r for r in old if r["type"] == "measurement" and _timed(r)}
    rows = []
    for row in new:
        if row["type"] != "measurement" or not _timed(row) or _row_key(row) not in before:
            continue
        other = before[_row_key(row)]
        result = {key: row[key] for key in ("model", "path", "options", "nbatch")}
        result |= {"status": "ok", "detail": "", "ratio": None}
        try:
            if row["workload_digest"] != other["workload_digest"]:
                raise InputError("not comparable, they did other work")
            faster = stats.unpaired(
                stats.TimedBlocks(_per_step(row), identity(row, new[0])),
                stats.TimedBlocks(_per_step(other), identity(other, old[0])),
                across,
            )
            ratio = {"estimate": faster.median, "low": faster.low, "high": faster.high}
            result["ratio"] = ratio
        except InputError as error:
            result |= {"status": "input", "detail": str(error)}
        rows.append(result)
    return rows


def identity(row: Record, header: Record) -> dict[str, Any]:
    """Return what results must share to be compared without being asked to.

    Precision and device (a CPU by its name); of what was compiled also the versions of what
    compiled it, and the flags that change what it does.
    """
    machine, device = header["machine"], row.get("device") or "cpu"
    found = {
        "precision": row.get("precision", "float64"),
        "device": machine["cpu"] if device == "cpu" else device,
    }
    if _compiles(row):
        versions, flags = machine["versions"], machine["flags"]
        found |= {name: versions.get(name) for name in _COMPILERS}
        found |= {name: flags.get(name) for name in _COMPILER_FLAGS}
    return found


def judged(result: Record) -> bool:
    """Return whether a result was held to anything: an engine other than C, in free steps alone."""
    check = result.get("check")
    return check is None or bool(check["free_steps"])


def _row_key(row: Record) -> str:
    return f"{row['model']} {row['path']} {sorted(row['options'].items())} {row['nbatch']}"


def _per_step(row: Record) -> list[float]:
    return [seconds / (row["nbatch"] * row["nstep"]) for seconds in row["samples_s"]]


def _compiles(result: Record) -> bool:
    return "precision" in result


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
    result["nbatch_asked"] = row.get("nbatch_asked")
    if _compiles(row):
        result |= {key: row.get(key) for key in COMPILED} | {"overtakes_after_steps": None}
    if not _timed(row):
        return result
    steps, samples = row["nbatch"] * row["nstep"], row["samples_s"]
    median = statistics.median(samples) / steps
    result["steps_per_s"] = 1.0 / median
    result["step_ns"] = {"median": 1e9 * median, "min": 1e9 * min(samples) / steps}
    result["realtime_factor"] = timestep / median if timestep else None
    if base and _compiles(row):
        sides = (stats.TimedBlocks(base["samples_s"], {}), stats.TimedBlocks(samples, {}))
        result["speedup"] = asdict(stats.unpaired(*sides))
        gain = statistics.median(base["samples_s"]) / steps - median
        spent = (row["trace_s"] or 0.0) + row["compile_s"]
        result["overtakes_after_steps"] = spent / gain if gain > 0 else None
    elif base:
        n = min(len(base["samples_s"]), len(samples))
        estimate = stats.speedup(base["samples_s"][:n], samples[:n])
        result["speedup"] = {
            "median": estimate.median,
            "low": None if row is base else estimate.low,
            "high": None if row is base else estimate.high,
        }
    return result
