"""Do two sets of final states agree, and if not, where do they first differ?

Paths that run the same C engine must agree to the last bit, over all of mjSTATE_INTEGRATION.
Other engines, MJX and Warp, are held to tolerances where nothing constrains the motion, and
reported where something does: their colliders and solvers are other algorithms.
"""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from mjbench.simulation.trajectory import Contacts

# Counters of work that differ by more than this share, of the larger one, are other work.
SAME_WORK = 0.005
# Below this a difference after one step, in SI units, is rounding: the order of additions changed.
ROUNDING = 1e-9
# What a single free step of another engine may stray from C's, relative to the largest entry of a
# field where that exceeds 1.
FREE_LIMIT = {"float64": 1e-12, "float32": 1e-4}
# A run in float32 may stray this many times as far as C with float32 states does, or as a single
# free step of the same engine: C's shadow rounds states alone, an engine all that it computes.
SHADOW_FACTOR = 10.0
# A free run in float64 may stray by this.
FREE_RUN_LIMIT = 1e-10
# Strays of float32 and float64 that differ by less than this factor have another cause.
PRECISION_FACTOR = 10.0
# What strays by more is not a number.
FINITE = 1e300

_KINDS = {"free": "free", "constrained": "constrained", "contact": "in contact"}


@dataclass(frozen=True)
class Difference:
    """Where states first differ.

    Attributes:
      field: the MjData field.
      index: position within the field.
      simulation: index of the simulation.
      step: number of steps after which it shows, or None if not looked for.
      got: the value found.
      expected: the reference's value.
    """

    field: str
    index: int
    simulation: int
    got: float
    expected: float
    step: int | None = None

    def at(self, step: int) -> "Difference":
        """Return the same difference, seen after `step` steps."""
        return replace(self, step=step)

    def __str__(self) -> str:
        when = "at the end" if self.step is None else f"after step {self.step}"
        if np.isnan(self.got):
            what = "never written"
        else:
            what = f"{self.got!r} instead of {self.expected!r}"
        return f"{self.field}[{self.index}] of simulation {self.simulation} differs {when}: {what}"


def first_difference(
    values: np.ndarray,
    reference: np.ndarray,
    columns: Mapping[str, slice],
    held: np.ndarray | None = None,
) -> Difference | None:
    """Return where `values` first differs from `reference` in any bit, or None.

    First means the lowest simulation, then the first entry of its row.

    Args:
      values: (nbatch, nstate) float64 states.
      reference: (nbatch, nstate) float64 states to compare with.
      columns: where each field stands in a row.
      held: (nbatch, nstate) which entries to compare; None for all.
    """
    if values.shape != reference.shape:
        raise ValueError(f"states of shape {values.shape} against {reference.shape}")
    wrong = _bits(values) != _bits(reference)
    if held is not None:
        wrong &= held
    if not wrong.any():
        return None
    simulation, column = (int(i) for i in np.argwhere(wrong)[0])
    field, start = next(
        (name, where.start) for name, where in columns.items() if column < where.stop
    )
    return Difference(
        field,
        column - start,
        simulation,
        float(values[simulation, column]),
        float(reference[simulation, column]),
    )


def digest(states: np.ndarray) -> str:
    """Return 16 hexadecimal digits that name the states, bit by bit."""
    return hashlib.blake2b(np.ascontiguousarray(states).tobytes(), digest_size=8).hexdigest()


def _bits(states: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(states, dtype=np.float64).view(np.uint64)


def drift(after: Mapping[str, np.ndarray], reference: Mapping[str, np.ndarray]) -> float:
    """Return the largest difference between two results of `work.one_step`, in SI units.

    NaN, where one of them has one, is a difference: infinite.
    """
    largest = 0.0
    for field, values in after.items():
        difference = np.abs(values - reference[field])
        if difference.size:
            largest = max(largest, float(np.where(np.isnan(difference), np.inf, difference).max()))
    return largest


def work_changes(
    old: Mapping[str, float],
    new: Mapping[str, float],
    drift: float | None,
    diverged: tuple[int, int],
) -> list[str]:
    """Return in words how two sides did other work; empty where it was the same.

    Args:
      old: counters per step.
      new: the same of the new side.
      drift: largest difference one step after the same states; None where it cannot be told.
      diverged: simulations that diverged on each side.
    """
    words = counter_changes(old, new)
    if drift is not None and drift > ROUNDING:
        words.append(f"one step differs by {drift:.1g}")
    if diverged[0] != diverged[1]:
        words.append(f"{diverged[1]} simulations diverge instead of {diverged[0]}")
    return words


def counter_changes(old: Mapping[str, float], new: Mapping[str, float]) -> list[str]:
    """Return the counters of work that changed, in words such as `contacts 1 → 5`."""
    return [
        f"{name.replace('_', ' ')} {before:.4g} → {new[name]:.4g}"
        for name, before in old.items()
        if name in new and abs(new[name] - before) > SAME_WORK * max(abs(before), abs(new[name]))
    ]


def max_relative_error(
    got: Mapping[str, np.ndarray], want: Mapping[str, np.ndarray], names: Sequence[str]
) -> np.ndarray:
    """Return (n,) how far rows stray: the largest difference of any entry of the named fields.

    A difference counts relative to the largest entry of its field in that row, where that exceeds
    1; NaN counts as the largest number there is.

    Args:
      got: (n, size) arrays by MjData field.
      want: the reference's; fields that `got` lacks are passed over.
      names: fields to compare.
    """
    worst = np.zeros(len(next(iter(want.values()))))
    for name in names:
        if name in want and name in got and want[name].shape[1]:
            scale = np.maximum(1.0, np.abs(want[name]).max(axis=1, keepdims=True))
            difference = np.abs(got[name] - want[name]) / scale
            most = np.finfo(float).max  # JSON has no infinity
            finite = np.nan_to_num(difference, nan=most, posinf=most)
            worst = np.maximum(worst, finite.max(axis=1))
    return worst


def normal_angle(reference: "Contacts", found: "Contacts") -> float | None:
    """Return the largest angle between normals of contacts of the same geoms, in degrees.

    Every contact found is held against the nearest normal of the reference for the same two geoms;
    None where the two share no such contact.
    """
    largest = None
    for simulation in np.unique(found.simulation):
        ours = reference.simulation == simulation
        theirs = found.simulation == simulation
        for geom, normal in zip(found.geom[theirs], found.normal[theirs], strict=True):
            same = ours & (reference.geom == geom).all(axis=1)
            if same.any():
                cosine = np.clip((reference.normal[same] @ normal).max(), -1.0, 1.0)
                angle = float(np.degrees(np.arccos(cosine))) if np.isfinite(cosine) else 180.0
                largest = max(largest or 0.0, angle)
    return largest


def failures(check: Mapping[str, Any]) -> list[str]:
    """Return in words what another engine's check forbids; empty where it may be timed.

    Keys of a check: `precision`; for `free`, `constrained` and `contact` single steps `…_steps`
    and `…_stray` (the largest, None without any); `same_count` (share of steps in contact with as
    many contacts as the reference) and `normal_degrees`, where there are any; `still`, whether
    no single step led anywhere; for the run up to the first step that a constraint acted on
    (`free`) and to the end (`final`) `…_nstep`, `…_difference` from the reference and `…_shadow`,
    that of C with float32 states; `final_shadow_median`, over simulations; `lost`, simulations that
    do not end in finite numbers; `received`, whether the engine had the very start states and
    controls.
    """
    found, precision = [], check["precision"]
    if not check["received"]:
        found.append("it does not hold the start states or controls that it was given")
    stray, limit = check["free_stray"], FREE_LIMIT[precision]
    if stray is not None and not stray <= limit:
        found.append(f"a free step strays by {stray:.2g}, more than {limit:g}")
    found += [
        f"a step {_KINDS[kind]} does not end in finite numbers"
        for kind in ("constrained", "contact")
        if check[f"{kind}_stray"] is not None and check[f"{kind}_stray"] > FINITE
    ]
    if check["still"]:
        found.append("it stands still")
    if check["free_nstep"]:
        allowed = FREE_RUN_LIMIT
        if precision == "float32":
            rounding = max(stray or 0.0, float(np.finfo(np.float32).eps))
            allowed = SHADOW_FACTOR * max(check["free_shadow"], rounding)
        if not check["free_difference"] <= allowed:
            found.append(
                f"{check['free_nstep']} free steps stray by {check['free_difference']:.2g},"
                f" more than {allowed:.2g}"
            )
    if check["lost"]:
        found.append(f"{check['lost']} simulations do not end in finite numbers")
    return found


def words(check: Mapping[str, Any]) -> str:
    """Return in a line what another engine's check found (see `failures`)."""
    said = [
        f"{check[f'{kind}_steps']} single steps {name} within {check[f'{kind}_stray']:.1g}"
        for kind, name in _KINDS.items()
        if check[f"{kind}_steps"]
    ]
    if check.get("same_count") is not None:
        said.append(f"as many contacts as C in {100 * check['same_count']:.0f} %")
    if check.get("normal_degrees") is not None:
        said.append(f"normals within {check['normal_degrees']:.2g}°")
    said.append(
        f"after {check['final_nstep']} steps {check['final_difference']:.1g} off"
        f" (C with float32 states: {check['final_shadow']:.1g})"
    )
    return ", ".join(said)


def cause(float32: Mapping[str, Any], float64: Mapping[str, Any]) -> str:
    """Return whether an engine's float32 check strays by precision or by algorithm, in words.

    Args:
      float32: check of the engine in float32.
      float64: its check in float64, on the same steps.
    """
    for kind in ("contact", "constrained", "free"):
        coarse, fine = float32[f"{kind}_stray"], float64[f"{kind}_stray"]
        if coarse is not None and fine is not None:
            if fine * PRECISION_FACTOR < coarse:
                return f"precision: in float64 a step strays by {fine:.1g} instead of {coarse:.1g}"
            return f"algorithm: in float64 a step strays by {fine:.1g}, about as much"
    return "unknown: no step of one is like one of the other"
