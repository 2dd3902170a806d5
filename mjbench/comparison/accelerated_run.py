"""One accelerated path on one model, in a process of its own (see `isolate`).

It takes the workload from the file that `measure` left, bit by bit; compiles; takes single steps
from states of the reference run and judges them; and only then times the steady program.
"""

import dataclasses
import resource
import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from mjbench import paths
from mjbench.errors import InputError
from mjbench.instrument import isolate, machine, timing
from mjbench.instrument.isolate import Channel, Message
from mjbench.paths.accelerated import (
    AcceleratedPath,
    Compiled,
    StepOutcome,
    load_workload,
    reference_peaks,
    start_fields,
)
from mjbench.simulation import accelerated_check, agreement, models, trajectory, work, workload
from mjbench.simulation.accelerated_check import AcceleratedCheck
from mjbench.simulation.trajectory import COMPARED, Contacts, SingleSteps

# Simulations followed step by step, spread over the batch, and the most single steps taken from
# their states; these are taken again in every simulation that is left.
FOLLOWED, MOST_SINGLES = 32, 256
# Timed blocks: for this many seconds, no fewer and no more than these.
STEADY_S, LEAST_BLOCKS, MOST_BLOCKS = 2.0, 7, 100
# Share of the free memory that the child of one path may take.
SHARE_OF_MEMORY = 0.8
# A compiler may be silent for this many times the limit of anything else.
COMPILER_PATIENCE = 5
# On a CPU MJX is slow on a model that makes contact (docs/method.md gives figures), and compiles
# RK4, which has four of everything, for minutes: not tried unless named.
CONTACT_REASON = "makes contact, where it is slow on a CPU; name it with --paths to try it"
RK4_REASON = "is integrated by RK4, which compiles for minutes; name it with --paths to try it"


def run(
    source: models.ModelSource,
    name: str,
    options: Mapping[str, Any],
    work: Path,
    on_message: Callable[[Message], None],
    named: bool = True,
    limit_s: float = 60.0,
    import_from: str | None = None,
) -> isolate.Ended:
    """Measure one path on one model in a child; whatever becomes of it, this process goes on.

    Args:
      source: the model.
      name: of the path.
      options: of the path.
      work: file that `accelerated.save_workload` left.
      on_message: called with the child's messages (see `measure`).
      named: whether the user asked for this path; else one that is hopeless is not tried.
      limit_s: seconds of silence after which the child is killed; its compiler gets more.
      import_from: a folder that a path of the user's own may be imported from.
    """
    request = {
        "model": {"name": source.name, "path": str(source.path.resolve())},
        "path": name,
        "options": dict(options),
        "work": str(work),
        "named": named,
        "limit_s": limit_s,
    }
    memory = int(SHARE_OF_MEMORY * machine.available_memory_bytes())
    task, environment = (
        "mjbench.comparison.accelerated_run:measure",
        _accelerated(name).environment(),
    )
    return isolate.run(task, request, on_message, limit_s, import_from, environment, memory)


def _accelerated(name: str) -> AcceleratedPath:
    path = paths.find(name)
    if not isinstance(path, AcceleratedPath):
        raise InputError(f"path {name} does not compile")
    return path


def measure(request: dict[str, Any], channel: Channel) -> None:
    """Measure one path on one model.

    Request keys: `model` (name, path), `path`, `options`, `work` (file that
    `accelerated.save_workload` left), `named` (whether the user asked for this path), `limit_s`.

    Messages: `verdict` (agreement), `compiled` (device, seconds of its stages), `sample` (seconds
    of a steady block), `memory` (bytes at most, of the process and of a GPU).
    """
    name, path = request["model"]["name"], _accelerated(request["path"])
    channel.where(f"loading {name}")
    model = models.load(models.ModelSource(name, Path(request["model"]["path"])))
    made, resources = load_workload(model, Path(request["work"]))
    verdict: dict[str, Any] = {"kind": "verdict", "status": "ok", "detail": ""}
    channel.where(f"preparing {path.name} on {name}")
    channel.expect(COMPILER_PATIENCE * request["limit_s"])
    reason = path.unavailable()
    device = None if reason else path.device_kind()
    reason = reason or path.unsuited(made, request["options"])
    if reason is None and not request["named"] and device == "cpu":
        reason = _hopeless(made, resources)
    if reason:
        channel.send(**verdict | {"status": "unavailable", "detail": reason})
        return
    channel.where(f"compiling {path.name} for {name}")
    compiled = path.prepare(made, request["options"], resources)
    channel.send(
        kind="compiled",
        device=compiled.device,
        trace_s=compiled.trace_s,
        compile_s=compiled.compile_s,
        workload_digest=made.digest(),
    )
    channel.where(f"checking {path.name} on {name}")
    advance = compiled.advance

    def patient(*arguments: Any) -> StepOutcome:
        channel.expect(request["limit_s"])  # each call anew: a program that hangs is soon found
        return advance(*arguments)

    compiled = dataclasses.replace(compiled, advance=patient)
    checked, final = check(made, compiled, path.precision)
    failures = accelerated_check.failures(checked)
    verdict["snippet"] = path.snippet(made, {**request["options"], **compiled.buffer_sizes})
    if failures:
        verdict |= {"status": "disagrees", "detail": "; ".join(failures)}
    channel.send(
        **verdict, agrees=not failures, agreement=accelerated_check.summary(checked), check=checked
    )
    if not failures:
        channel.where(f"timing {path.name} {request['options']}")
        _time(compiled, channel, request["limit_s"])
        wrong = _other_end(made, compiled, final, checked)
        if wrong:
            verdict |= {"status": "disagrees", "detail": wrong}
            channel.send(**verdict, agrees=False, agreement=wrong, check=checked)
    channel.send(
        kind="memory", memory_bytes=memory_bytes(), gpu_memory_bytes=compiled.gpu_memory_bytes()
    )
    resources.close()


def check(
    made: workload.Workload, compiled: Compiled, precision: str
) -> tuple[AcceleratedCheck, Mapping[str, np.ndarray]]:
    """Return how far a compiled run strays from the reference, and the fields that it ends in.

    See `accelerated_check.failures`.
    """
    rounded = precision == "float32"
    reference = trajectory.record_trajectory(made, FOLLOWED)
    taken = trajectory.single_steps(made, reference, MOST_SINGLES, rounded)
    after = _single_steps(compiled, made, taken)
    found = _judged_singles(made, taken, after) | {"precision": precision}
    followed = reference.simulation
    shadow = trajectory.record_trajectory(made, FOLLOWED, rounded=True)
    starts = start_fields(made)
    final = compiled.advance(starts, made.control, made.nstep).fields
    found["received"] = _received(made, compiled, starts, final, rounded)
    for key, nstep in (("unconstrained", reference.unconstrained_nstep), ("final", made.nstep)):
        got = final
        if nstep < made.nstep:
            got = compiled.advance(starts, made.control, nstep).fields
        found[f"{key}_nstep"] = nstep
        want = workload.fields(made.model, reference.states[:, nstep])
        rounding = workload.fields(made.model, shadow.states[:, nstep])
        reached = {name: values[followed] for name, values in got.items()}
        shaded = agreement.max_relative_error(rounding, want, COMPARED)
        found[f"{key}_difference"] = float(
            agreement.max_relative_error(reached, want, COMPARED).max()
        )
        found[f"{key}_shadow"] = float(shaded.max())
    found["final_shadow_median"] = float(np.median(shaded))
    whole = np.isfinite(np.hstack([final[n] for n in COMPARED if n in final])).all(axis=1)
    found["lost"] = int((~whole).sum())
    return AcceleratedCheck(**found), final


def _other_end(
    made: workload.Workload,
    compiled: Compiled,
    final: Mapping[str, np.ndarray],
    checked: AcceleratedCheck,
) -> str:
    """Return how the last timed block ended elsewhere than the run that was checked, if it did.

    What does not repeat to the last bit may stray as rounding to float32 does in C: the farthest
    simulation where all motion is free. In contact some simulations go ways of their own for any
    difference, and which ones is chance: there it is the median of simulations that counts.
    """
    reached = compiled.final_states()
    got = workload.fields(made.model, reached.values)
    strayed = agreement.max_relative_error(got, final, COMPARED)
    lost = int((strayed > accelerated_check.FINITE_LIMIT).sum())
    if lost:
        return f"in timed blocks {lost} simulations do not end in finite numbers"
    stray, allowed = float(strayed.max()), 0.0
    if not compiled.is_deterministic:
        shadow = checked.final_shadow
        if checked.unconstrained_nstep < made.nstep:
            stray, shadow = float(np.median(strayed)), checked.final_shadow_median
        allowed = accelerated_check.SHADOW_FACTOR * max(shadow, float(np.finfo(np.float32).eps))
    if stray <= allowed:
        return ""
    return f"timed blocks end {stray:.2g} from the run that was checked"


def _received(
    made: workload.Workload,
    compiled: Compiled,
    starts: Mapping[str, np.ndarray],
    final: Mapping[str, np.ndarray],
    rounded: bool,
) -> bool:
    """Return whether the engine starts from the very states, and has the first and last control."""

    def exactly(values: np.ndarray) -> np.ndarray:
        return trajectory.as_float32(values) if rounded else values

    begun = compiled.advance(starts, made.control, 0).fields
    same = [np.array_equal(begun[n], exactly(v)) for n, v in starts.items() if n in begun]
    first = compiled.advance(starts, made.control, 1).fields["ctrl"]
    same.append(np.array_equal(first, exactly(made.control[:, 0])))
    same.append(np.array_equal(final["ctrl"], exactly(made.control[:, -1])))
    return all(same)


def _single_steps(compiled: Compiled, made: workload.Workload, taken: SingleSteps) -> StepOutcome:
    """Take the single steps by the compiled program, as many at a time as it has simulations.

    From the first again where simulations are left: every one takes a step that is judged.
    """
    nbatch, count = made.nbatch, len(taken.state)
    states = workload.fields(made.model, taken.state)
    states.pop("ctrl", None)
    parts: list[StepOutcome] = []
    for begin in range(0, count, nbatch):
        rows = np.arange(begin, begin + nbatch) % count
        control = np.zeros_like(made.control)
        control[:, 0] = taken.control[rows]
        parts.append(compiled.advance({n: v[rows] for n, v in states.items()}, control, 1))
    fields = {
        name: np.concatenate([part.fields[name] for part in parts]) for name in parts[0].fields
    }
    if any(part.contacts is None for part in parts):
        return StepOutcome(fields, None)
    return StepOutcome(fields, Contacts.joined([p.contacts for p in parts if p.contacts], nbatch))


def _judged_singles(
    made: workload.Workload, taken: SingleSteps, after: StepOutcome
) -> dict[str, Any]:
    """Return how far single steps stray: free ones, constrained ones, those in contact."""
    count, total = len(taken.state), len(next(iter(after.fields.values())))
    step = np.arange(total) % count  # which of the steps a row took
    want = {n: v[step] for n, v in workload.fields(made.model, taken.after).items()}
    before = {n: v[step] for n, v in workload.fields(made.model, taken.state).items()}
    stray = agreement.max_relative_error(after.fields, want, COMPARED)
    contacts = taken.contacts.counts(count)[step]
    touching, constrained = contacts > 0, taken.constraints[step] > 0
    moves = agreement.max_relative_error(want, before, COMPARED) > 0
    stands = agreement.max_relative_error(after.fields, before, COMPARED) == 0
    found: dict[str, Any] = {"still": bool(moves.any() and stands[moves].all())}
    if after.contacts is not None and touching.any():
        same = after.contacts.counts(total) == contacts
        found["same_count"] = float(same[touching].mean())
        found["normal_degrees"] = accelerated_check.normal_angle(
            taken.contacts, after.contacts.first(count)
        )
    kinds = {
        "unconstrained": ~touching & ~constrained,
        "constrained": ~touching & constrained,
        "contact": touching,
    }
    for kind, rows in kinds.items():
        found[f"{kind}_steps"] = int(rows[:count].sum())
        found[f"{kind}_error"] = float(stray[rows].max()) if rows.any() else None
    return found


def _time(compiled: Compiled, channel: Channel, limit_s: float) -> None:
    """Send the seconds of steady blocks, after one that warms up."""
    channel.expect(2 * limit_s)
    contender = timing.Contender(compiled.clear, compiled.run, lambda: None)
    timing.block_s(contender)
    end = time.perf_counter() + STEADY_S
    for done in range(1, MOST_BLOCKS + 1):
        channel.send(kind="sample", seconds=timing.block_s(contender))
        if time.perf_counter() > end and done >= LEAST_BLOCKS:
            break


def memory_bytes() -> int:
    """Return the most memory that this process has had, in bytes."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return int(peak) * (1 if sys.platform == "darwin" else 1024)


def _hopeless(made: workload.Workload, resources: paths.Resources) -> str | None:
    """Return why MJX on a CPU is not worth trying on a workload, or None."""
    if work.describe(made.model).integrator == "rk4":
        return RK4_REASON
    return CONTACT_REASON if reference_peaks(made, resources).contacts else None
