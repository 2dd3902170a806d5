"""Values that tests of tuning share: distances, what present settings do, a stored search."""

import json

from mjbench.host import machine
from mjbench.paired.records import LaunchRow
from mjbench.simulation.starts import Starts, Window
from mjbench.store import run_writer, runs
from mjbench.tuning.accuracy import Distance, Units
from mjbench.tuning.contact_and_energy import Physics
from mjbench.tuning.reference import Present

NOTHING = Physics(0.0, 0.0, 0.0, 0.0)
PRESENT_ERROR = 0.02

DISTANCE = {"share": 1e-4, "position": {"m": 1e-5, "rad": 2e-5}, "velocity": {"m": 1, "rad": 2}}
PROGRAM = {"error": DISTANCE, "trace_s": 0.5, "compile_s": 12.0, "buffer_sizes": {"njmax": 64}}
EDIT = {"part": "option", "name": "iterations", "value": "4"}
FEWER = {"knob": "iterations", "label": "iterations=4", "edits": [EDIT], "buffer_sizes": {}}
SPARSE = {"knob": "jacobian", "label": "jacobian=sparse"}
SAMPLES = {"core": None, "cores": None, "orders": ["ABBA"], "ns": [[1000, 800, 800, 1000]]}
FACTS = {
    "device": "cpu",
    "precision": "float32",
    "nrun": 64,
    "horizon_s": 0.5,
    "horizon_ncontrol": 31,
    "starts": {"settle_s": 0.1, "asked_s": 0.1},
    "rounding": DISTANCE,
    "settings": [FEWER],
}
# A search for settings of Warp, as earlier versions stored it.
ENGINE_TUNE = {
    "type": "engine_tune",
    "model": "robot",
    "engine": "warp",
    "status": "ok",
    "nbatch": 64,
    "facts": FACTS,
    "present": PROGRAM,
    "attempts": [
        {"settings": [FEWER], "status": "ok", "program": PROGRAM, "samples": SAMPLES},
        {"settings": [SPARSE], "status": "failed", "detail": "no such kernel", "program": None},
    ],
    "front": [
        {
            "settings": [FEWER],
            "ratio": {"estimate": 0.8, "low": 0.78, "high": 0.82},
            "error": DISTANCE,
            "program": PROGRAM,
            "samples": [SAMPLES] * 4,
        }
    ],
    "withdrawn": [{"settings": [], "reason": "not certainly faster"}],
}


def apart(share):
    """Return a distance of positions and velocities, in metres as large as its share."""
    return Distance(share, Units(share, None), Units(share, None))


def blocks(ratio):
    """Return a launch in which settings take `ratio` of the time of the present ones."""
    present_ns, candidate_ns = 1_000_000, round(1_000_000 * ratio)
    quad = [present_ns, candidate_ns, candidate_ns, present_ns]
    return LaunchRow(None, None, ["ABBA"] * 2, [quad] * 2)


def present(error=PRESENT_ERROR, is_comparable=True, solver_limited=0.0):
    """Return what the present settings do, with an error."""
    window = Window(64, 248, 1.0, solver_limited, None, None, 0, None, {})
    return Present(
        nrun=64,
        horizon_s=0.5,
        horizon_ncontrol=31,
        ncontrol=62,
        run_s=1.0,
        is_comparable=is_comparable,
        starts=Starts(0.1, 0.1, window=window),
        error=apart(error),
        rounding=apart(1e-15),
        solver=apart(1e-2 if solver_limited else 1e-8),
        motion_m=1.0,
        motion_rad=None,
        physics=NOTHING,
        reference_physics=NOTHING,
        converged_error=apart(0.1 * error),
    )


def stored(folder, record):
    """Return a run file with one record."""
    header = runs.RunHeader(runs.SCHEMA, "tune", machine.describe(), {})
    file = run_writer.RunFile.create(folder, header)
    file.close()
    with file.path.open("a") as stream:
        stream.write(json.dumps(record) + "\n")
    return file.path
