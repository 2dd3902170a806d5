"""The program whose instructions are counted: steps models between calls of a marker.

It runs under Callgrind, inside the environment of any release (see instructions.py). For each
model the work is done once to warm it up, then twice, each time between two calls of `mj_version`,
at which Callgrind writes out what it counted so far.
"""

import json
import pickle
from pathlib import Path
from typing import Any

# Calls of the marker for each model.
MARKERS = 3


def main(request_file: str) -> None:
    """Step the models of a request; write what the work was beside it, a line of JSON for each.

    The request names `version` and `models`: name, path, and `work`, the file of a workload; where
    there is no such file it is made, of nbatch, nstep, hold and seed.
    """
    import mujoco

    from mjbench.errors import MjbenchError
    from mjbench.releases import install_check

    request = json.loads(Path(request_file).read_text(encoding="utf-8"))
    problem = install_check.imported_problem(request["version"])
    if problem:
        raise SystemExit(problem)
    with Path(request_file).with_name("answers.jsonl").open("w", encoding="utf-8") as out:
        for entry in request["models"]:
            try:
                answer = {"name": entry["name"], "status": "ok", **_count(entry)}
            except MjbenchError as error:
                answer = {"name": entry["name"], "status": "input", "detail": str(error)}
                for _ in range(MARKERS):
                    mujoco.mj_version()
            out.write(json.dumps(answer) + "\n")
            out.flush()


def _count(entry: dict[str, Any]) -> dict[str, Any]:
    """Do the work of one model between markers; return what it was."""
    import mujoco

    from mjbench import paths
    from mjbench.simulation import models, work, workload

    model = models.load(models.ModelSource(entry["name"], Path(entry["path"])))
    file = Path(entry["work"])
    if not file.is_file():
        made, _, _ = work.stable_workload(
            model, *(entry[key] for key in ("nbatch", "nstep", "hold", "seed"))
        )
        whole = file.with_suffix(".part")
        whole.write_bytes(pickle.dumps(workload.portable(made)))
        whole.rename(file)
    made = workload.restore(model, pickle.loads(file.read_bytes()))
    seen = work.observe(made)
    run = paths.find("python_loop").prepare(made, {}, paths.Resources(made)).run
    run()
    mujoco.mj_version()
    for _ in range(MARKERS - 1):
        run()
        mujoco.mj_version()
    after = work.one_step(model, made.initial_state)
    return {
        "steps": made.steps,
        "work": seen.work.as_dict(),
        "diverged": int((~seen.healthy).sum()),
        "after": {field: values.tolist() for field, values in after.items()},
    }
