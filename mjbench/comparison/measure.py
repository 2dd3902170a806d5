"""Measure every path on one model; runs in a child process (see `isolate`).

The order is: load, choose sizes, reference run, then for each variant prepare and verify, and
only then time those that agree, in turns. Every block's final states are compared again.
"""

import statistics
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mjbench import paths
from mjbench.errors import InputError
from mjbench.instrument import machine, stats, timing
from mjbench.instrument.isolate import Channel
from mjbench.paths.accelerated import save_workload
from mjbench.simulation import agreement, compat, models, work
from mjbench.simulation.workload import Workload, make

# Sizes unless the user names them. Where a block of the plain loop would take longer than
# LONG_BLOCK_S they shrink until it takes about BLOCK_S, first the steps, then the simulations, to
# no fewer than the least; where that is still too long the steps shrink again, to one if need be,
# unless paths that compile take part: one step alone would time what their program begins with.
NBATCH, NSTEP = 64, 200
LEAST_NSTEP, LEAST_NBATCH = 10, 8
LONG_BLOCK_S, BLOCK_S = 0.08, 0.05
# Timed rounds: half of the time for all variants, in at least as many rounds as a 95 % interval
# needs, and the rest for those that may be the fastest, judged anew every few rounds: advice has
# to tell them apart.
BUDGET_S = 8.0
LEAST_ROUNDS, FINAL_ROUNDS, MOST_ROUNDS = 7, 4, 200
# A child may be silent for this many times as long as what it does should take.
PATIENCE = 100
# The model that stands in where a model starts without contact: a path that loses the warm-start
# can only be told in contact.
CONTACT_MODEL, CONTACT_NBATCH, CONTACT_NSTEP = "cube_table", 4, 20
# Share of the free memory that a workload and a rollout's output may take.
SHARE_OF_MEMORY = 0.6


@dataclass(frozen=True)
class Variant:
    """A path with its options set."""

    path: paths.SteppingPath
    options: dict[str, Any]

    def __str__(self) -> str:
        words = [f"{name}={value}" for name, value in self.options.items()]
        return " ".join([self.path.name, *words])


@dataclass
class Bench:
    """A workload, its reference run, and what its paths share."""

    workload: Workload
    observed: work.Observation
    resources: paths.Resources
    columns: dict[str, slice]

    @classmethod
    def of(cls, kept: Workload, observed: work.Observation) -> "Bench":
        """Return the bench of a workload and its reference run."""
        columns = compat.state_columns(kept.model, compat.state_spec("INTEGRATION"))
        return cls(kept, observed, paths.Resources(kept), columns)

    def difference(self, states: paths.States) -> agreement.Difference | None:
        """Return where `states` first differ from the reference, or None."""
        return agreement.first_difference(
            states.values, self.observed.final_state, self.columns, states.mask
        )


def measure(request: dict[str, Any], channel: Channel) -> None:
    """Measure one model by every variant that `request` asks for.

    Request keys: `model` (name, path), `variants` (list of path, options), `exclude` (indices
    not to touch), `nbatch`, `nstep` (None: chosen here), `hold`, `seed`, `budget_s`,
    `largest` (most threads asked for), `work` (a file to leave the workload in, or None).

    Messages: `model` (facts, sizes, work), `verdict` (a variant's agreement), `ready`, `round`
    (seconds of the variants timed in it, cores of the calibration), `broken` (a variant whose
    timed block disagreed). The last rounds hold only those that may be the fastest (see
    `finalists`), and the base.
    """
    name = request["model"]["name"]
    channel.where(f"loading {name}")
    model = models.load(models.ModelSource(name, Path(request["model"]["path"])))
    channel.where(f"stepping {name}")
    nbatch, nstep, reduced = sizes(model, request)
    _check_memory(model, nbatch, nstep)
    patience_s = PATIENCE * nbatch * nstep * work.step_s(model)
    channel.expect(patience_s)
    workload, observed, spread = work.stable_workload(
        model, nbatch, nstep, request["hold"], request["seed"]
    )
    if request["work"]:
        save_workload(workload, observed.peaks, Path(request["work"]))
    bench = Bench.of(workload, observed)
    channel.send(kind="model", **_about(bench, nbatch, reduced), spread=spread)
    contact = None if bench.observed.start_contacts else _contact_bench(request)
    timed: dict[int, paths.Prepared] = {}
    for index, (path_name, options) in enumerate(request["variants"]):
        if index in request["exclude"]:
            continue
        variant = Variant(paths.find(path_name), options)
        channel.where(f"preparing {variant} on {name}")
        channel.expect(patience_s)
        prepared = _verified(variant, bench, contact, index, channel)
        if prepared is not None:
            timed[index] = prepared
    if contact:
        contact.resources.close()
    if timed:
        channel.expect(patience_s * len(timed))
        _time(timed, bench, request, channel)
    bench.resources.close()


def _about(bench: Bench, nbatch: int, reduced: bool) -> dict[str, Any]:
    workload, observed = bench.workload, bench.observed
    return {
        "facts": work.describe(workload.model),
        "nbatch": workload.nbatch,
        "nstep": workload.nstep,
        "hold": workload.hold,
        "seed": workload.seed,
        "reduced": reduced,
        "diverged": nbatch - workload.nbatch,
        "divergence": observed.diagnosis(),
        "workload_digest": workload.digest(),
        "state_digest": agreement.digest(observed.final_state),
        "start_contacts": observed.start_contacts,
        "work": observed.work.as_dict(),
    }


def _contact_bench(request: dict[str, Any]) -> Bench:
    """Return a small workload that starts in contact, for a model that does not."""
    model = models.load(models.resolve(CONTACT_MODEL))
    hold = request["hold"]
    nstep = hold * max(1, CONTACT_NSTEP // hold)
    workload = make(model, CONTACT_NBATCH, nstep, hold, request["seed"])
    return Bench.of(*work.observe_healthy(workload))


def _verified(
    variant: Variant, bench: Bench, contact: Bench | None, index: int, channel: Channel
) -> paths.Prepared | None:
    """Prepare and verify a variant; send its verdict; return it if it may be timed."""
    path, options = variant.path, variant.options
    verdict: dict[str, Any] = {"kind": "verdict", "index": index, "status": "ok", "detail": ""}
    reason = path.unavailable() or path.unsuited(bench.workload, options)
    if reason:
        channel.send(**{**verdict, "status": "unavailable", "detail": reason})
        return None
    try:
        prepared = path.prepare(bench.workload, options, bench.resources)
        difference = bench.difference(prepared.verified_states())
        place = ""
        if difference:
            difference = _located(variant, bench, difference)
        elif contact:
            place = f", on {CONTACT_MODEL}"
            difference = contact.difference(
                path.prepare(contact.workload, options, contact.resources).verified_states()
            )
            if difference:
                difference = _located(variant, contact, difference)
    except Exception as error:  # a path's own failure costs its own row
        detail = f"{type(error).__name__}: {' '.join(str(error).split())[:200]}"
        channel.send(**{**verdict, "status": "failed", "detail": detail})
        return None
    rule = "bit-identical" + (f", also in contact ({CONTACT_MODEL})" if contact else "")
    verdict["snippet"] = path.snippet(bench.workload, options)
    if difference:
        verdict |= {"status": "disagrees", "detail": f"{difference}{place}"}
        channel.send(**verdict, agrees=False, agreement=verdict["detail"])
        return None
    channel.send(**verdict, agrees=True, agreement=rule)
    return prepared


def _located(variant: Variant, bench: Bench, at_end: agreement.Difference) -> agreement.Difference:
    """Return the difference at the first step where shorter runs show one.

    Runs of 1, 2, 4, … controls find a stretch where the difference begins, halving finds its
    start. Nothing shorter may show it (a race): then the difference at the end is all there is.
    """

    def seen(ncontrol: int) -> agreement.Difference | None:
        shorter = Bench.of(*work.observe_healthy(bench.workload.first(ncontrol)))
        try:
            prepared = variant.path.prepare(shorter.workload, variant.options, shorter.resources)
            return shorter.difference(prepared.verified_states())
        finally:
            shorter.resources.close()

    good, bad, found = 0, 1, seen(1)
    while found is None:
        if bad == bench.workload.ncontrol:
            return at_end
        good, bad = bad, min(2 * bad, bench.workload.ncontrol)
        found = seen(bad)
    while bad - good > 1:
        middle = (good + bad) // 2
        difference = seen(middle)
        if difference is None:
            good = middle
        else:
            bad, found = middle, difference
    return found.at(bad * bench.workload.hold)


def _time(
    timed: dict[int, paths.Prepared], bench: Bench, request: dict[str, Any], channel: Channel
) -> None:
    """Time the prepared variants in turns, comparing the final states of every block."""
    broken: dict[int, agreement.Difference] = {}

    def contender(index: int, prepared: paths.Prepared) -> timing.Contender:
        name, _ = request["variants"][index]

        def before() -> None:
            channel.where(f"timing {name} {request['variants'][index][1]}")
            prepared.clear()

        def after() -> None:
            difference = bench.difference(prepared.final_states())
            if difference and index not in broken:
                broken[index] = difference

        return timing.Contender(before, prepared.run, after)

    contenders = {index: contender(index, prepared) for index, prepared in timed.items()}
    cores = min(machine.usable_cores(), request["largest"])
    calibration = machine.Calibration(cores) if cores > 1 else None
    about_cores = (
        [
            timing.Contender(_nothing, calibration.single, _nothing),
            timing.Contender(_nothing, calibration.together, _nothing),
        ]
        if calibration
        else []
    )
    longest = sum(timing.block_s(c) for c in [*contenders.values(), *about_cores])  # warm-up
    budget_s = request["budget_s"]
    channel.send(kind="ready", round_s=longest, budget_s=budget_s)
    channel.expect(PATIENCE * longest)

    made: list[dict[int, float]] = []

    def rounds(indices: Sequence[int], budget_s: float, least: int, most: int) -> None:
        turns = [*(contenders[i] for i in indices), *about_cores]
        seed = request["seed"] + len(made)
        for seconds in timing.rounds(turns, budget_s, least, most, seed):
            had = calibration.cores(seconds[-2], seconds[-1]) if calibration else 1.0
            made.append(dict(zip(indices, seconds, strict=False)))
            channel.send(kind="round", seconds={str(i): s for i, s in made[-1].items()}, cores=had)
            channel.expect(PATIENCE * longest)

    end = time.perf_counter() + budget_s
    rounds(list(contenders), budget_s / 2, LEAST_ROUNDS, MOST_ROUNDS)
    closed = [i for i in timed if paths.find(request["variants"][i][0]).closed_loop]
    base = [i for i in timed if request["variants"][i][0] == paths.BASE]
    final = finalists(made, [list(timed), closed], base)
    while len(final) > len(base) and len(made) < 2 * MOST_ROUNDS:
        rounds(final, end - time.perf_counter(), FINAL_ROUNDS, FINAL_ROUNDS)
        if time.perf_counter() >= end - longest:
            break
        final = finalists(made, [final, [i for i in closed if i in final]], base)
    for index, difference in broken.items():
        channel.send(kind="broken", index=index, detail=f"in a timed block: {difference}")


def finalists(
    rounds: Sequence[dict[int, float]], groups: Sequence[Sequence[int]], always: Sequence[int]
) -> list[int]:
    """Return the variants that may be the fastest of a group, and those of `always`.

    A variant may be the fastest unless the 95 % interval of its time over that of the group's
    fastest lies above 1.

    Args:
      rounds: seconds by variant; whoever is missing from one is missing from all that follow.
      groups: variants that compete with each other.
      always: variants that stay whatever their speed.
    """
    seconds = {i: [r[i] for r in rounds if i in r] for group in groups for i in group}
    stay = set(always)
    for group in groups:
        if not group:
            continue
        fastest = min(group, key=lambda i: statistics.median(seconds[i]))
        for i in group:
            n = min(len(seconds[i]), len(seconds[fastest]))
            lead = stats.speedup(seconds[i][:n], seconds[fastest][:n])
            if i == fastest or lead.low is None or lead.low <= 1.0:
                stay.add(i)
    return sorted(stay)


def _nothing() -> None:
    pass


def sizes(model: Any, request: dict[str, Any]) -> tuple[int, int, bool]:
    """Return nbatch, nstep, and whether they were reduced to keep a block short."""
    nbatch, nstep, hold = request["nbatch"], request["nstep"], request["hold"]
    free_nbatch, free_nstep = nbatch is None, nstep is None
    nbatch, nstep = nbatch or NBATCH, nstep or max(hold, NSTEP - NSTEP % hold)
    asked = (nbatch, nstep)
    step_s = work.step_s(model)
    if nbatch * nstep * step_s <= LONG_BLOCK_S:
        return nbatch, nstep, False
    steps = max(1, int(BLOCK_S / step_s))
    least_nbatch = min(nbatch, max(LEAST_NBATCH, 4 * request["largest"]))
    if free_nstep:
        nstep = min(nstep, _multiple(max(LEAST_NSTEP, steps // nbatch), hold))
    if free_nbatch and nbatch * nstep > steps:
        nbatch = min(nbatch, max(least_nbatch, steps // nstep))
    most = max(1, int(LONG_BLOCK_S / step_s))
    if free_nstep and nbatch * nstep > most and not request["work"]:
        nstep = min(nstep, _multiple(max(1, most // nbatch), hold))
    return nbatch, nstep, (nbatch, nstep) != asked


def _multiple(count: int, hold: int) -> int:
    return hold * max(1, count // hold)


def _check_memory(model: Any, nbatch: int, nstep: int) -> None:
    """Refuse sizes whose states, controls and outputs would not fit into memory."""
    state = compat.state_size(model, compat.state_spec("INTEGRATION"))
    physics = compat.state_size(model, compat.state_spec("FULLPHYSICS"))
    row = 8 * state + 8 * nstep * (2 * model.nu + physics + model.nsensordata)
    needed, free = nbatch * (4 * 8 * state + row), machine.available_memory_bytes()
    if needed > SHARE_OF_MEMORY * free:
        raise InputError(
            f"{nbatch} simulations of {nstep} steps need about {needed / 2**30:.1f} GiB,"
            f" {free / 2**30:.1f} GiB are free: lower --nbatch or --nstep"
        )
