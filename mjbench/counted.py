"""The program whose instructions are counted: steps models between calls of a marker.

It runs under Callgrind, inside the environment of any release (see instructions.py). For each
model the work is done once to warm it up, then once more between two calls of `mj_version`, at
which Callgrind writes out what it counted so far.
"""

import json
import sys
from pathlib import Path
from typing import Any


def main(request_file: str) -> None:
    """Step the models of a request; write what the work was beside it, as JSON.

    The request names `version` and `models`: name, path, and either nbatch, nstep and seed, or
    `given`, the file of a workload taken apart by field.
    """
    import mujoco

    from mjbench import guard
    from mjbench.errors import MjbenchError

    folder = Path(request_file).parent
    request = json.loads(Path(request_file).read_text(encoding="utf-8"))
    problem = guard.imported_problem(request["version"])
    if problem:
        raise SystemExit(problem)
    answers = []
    with (folder / "answers.jsonl").open("w", encoding="utf-8") as out:
        for entry in request["models"]:
            (folder / "where.txt").write_text(entry["name"], encoding="utf-8")
            try:
                answer = {"name": entry["name"], "status": "ok", **_count(entry, folder)}
            except MjbenchError as error:
                answer = {"name": entry["name"], "status": "input", "detail": str(error)}
                mujoco.mj_version()
                mujoco.mj_version()
            answers.append(answer)
            out.write(json.dumps(answer) + "\n")
            out.flush()


def _count(entry: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Do the work of one model between two markers; return what it was."""
    import mujoco
    import numpy as np

    from mjbench import models, paths, work, workload

    model = models.load(models.Source(entry["name"], Path(entry["path"])))
    if entry.get("given"):
        with np.load(folder / entry["given"]) as stored:
            given = {key: stored[key] for key in stored.files}
        control, hold = given.pop("control"), int(given.pop("hold"))
        made = workload.Workload(model, workload.states(model, given), control, hold, 0)
    else:
        made = workload.make(model, entry["nbatch"], entry["nstep"], 1, entry["seed"])
        fields = workload.fields(model, made.initial_state)
        np.savez(folder / f"{entry['number']}.npz", control=made.control, hold=made.hold, **fields)  # type: ignore[arg-type]
    seen = work.observe(made)
    run = paths.find("python_loop").prepare(made, {}, paths.Resources(made)).run
    run()
    mujoco.mj_version()
    run()
    mujoco.mj_version()
    return {
        "steps": made.steps,
        "work": seen.work.as_dict(),
        "diverged": int((~seen.healthy).sum()),
    }


if __name__ == "__main__":
    main(sys.argv[1])
