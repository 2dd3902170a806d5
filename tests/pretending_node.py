"""A program that answers as Node does with our runner, and steps C instead of WebAssembly.

So all that surrounds Node is tested without it. The environment variable PRETEND names how it
misbehaves; see `Pretender`.
"""

import contextlib
import json
import os
import signal
import stat
import sys
import time
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

VERSION = "20.1.2"
MISBEHAVIOUR = "PRETEND"
TESTS = Path(__file__).parent


def program(folder: Path) -> Path:
    """Return an executable file that is this program, in a folder."""
    file = folder / "node"
    file.write_text(
        f"#!{sys.executable}\n"
        f"import sys; sys.path.insert(0, {str(TESTS)!r})\n"
        "import pretending_node\n"
        "pretending_node.main(sys.argv[1:])\n"
    )
    file.chmod(file.stat().st_mode | stat.S_IXUSR)
    return file


def package(folder: Path, version: str) -> Path:
    """Return a folder in which npm seems to have installed a release."""
    root = folder / "node_modules/@mujoco/mujoco"
    for build in (root, root / "mt"):
        build.mkdir(parents=True)
        (build / "mujoco.js").write_text("export default 0;\n")
        (build / "mujoco.wasm").write_bytes(b"\0asm")
    content = {"name": "@mujoco/mujoco", "version": version}
    (root / "package.json").write_text(json.dumps(content))
    return folder


class Pretender:
    """Steps models in C; at `PRETEND` it crashes, hangs, talks nonsense, or computes wrongly.

    `crash:ACTION`, `hang:ACTION`, `nonsense:ACTION` and `error:ACTION` happen when it is asked for
    an action; `wrong:STEP` moves the states of runs from a step on, `rounding:STEP` by less;
    `drift` moves single steps; `stale` ends blocks elsewhere; `old` has no thread pool.
    """

    def __init__(self, how: str):
        self.how, _, self.which = how.partition(":")
        self.blocks = 0

    def answer(self, action: str, request: dict[str, Any]) -> str:
        """Return JSON, or misbehave."""
        if self.which == action:
            if self.how == "crash":
                print("it went wrong", file=sys.stderr, flush=True)
                os.kill(os.getpid(), signal.SIGKILL)
            if self.how == "hang":
                time.sleep(600)
            if self.how == "nonsense":
                return "nonsense"
            if self.how == "error":
                return json.dumps({"error": "no such thing"})
        return json.dumps({"value": getattr(self, action)(**request)})

    def instantiate(self, script: str, nthread: int) -> dict[str, Any]:
        import mujoco

        manifest = Path(script).parents[1 if "/mt/" in script else 0] / "package.json"
        assert json.loads(manifest.read_text())["version"] == mujoco.__version__
        times = {"import_ms": 1.0, "instantiate_ms": 2.0, "heap_bytes": 100}
        has_threadpool = self.how != "old"
        return {"version": mujoco.__version__, **times, "has_threadpool": has_threadpool}

    def load(self, files: list[list[str]], model: str, engine_threads: int) -> float:
        import mujoco

        assert all(Path(here).is_file() for _, here in files)
        from_file = mujoco.MjModel.from_xml_path
        if model.endswith(".mjb"):
            from_file = mujoco.MjModel.from_binary_path
        self.model = from_file(model)
        self.data = mujoco.MjData(self.model)
        self.spec = int(mujoco.mjtState.mjSTATE_INTEGRATION)
        return 3.0

    def record(self, points: list[int], states_file: str, **steps: Any) -> None:
        states = self._step(**steps)
        nstep = states.shape[0] - 1
        qpos = slice(1, 1 + self.model.nq)
        if self.how == "wrong" and nstep > 1:
            states[int(self.which) :, :, qpos] += 1e-3
        if self.how == "drift" and nstep == 1:
            states[1, :, qpos] += 1e-3
        states[points].tofile(states_file)

    def prepare(self, **steps: Any) -> None:
        self.steps = steps

    def block(self) -> int:
        self.final = self._step(**self.steps)[-1]
        self.blocks += 1
        return 1000 + self.blocks % 2

    def save(self, states_file: str) -> None:
        (self.final + (self.how == "stale")).tofile(states_file)

    def memory(self) -> dict[str, Any]:
        return {"heap_bytes": 300, "rss_bytes": 400}

    def _step(
        self,
        starts_file: str,
        control_file: str,
        nbatch: int,
        ncontrol: int,
        hold: int,
        has_reset: bool,
    ) -> Any:
        """Return (nstep + 1, nbatch, nstate) states of a workload."""
        import mujoco
        import numpy as np

        starts = np.fromfile(starts_file).reshape(nbatch, -1)
        control = np.fromfile(control_file).reshape(nbatch, ncontrol, self.model.nu)
        states = np.empty((ncontrol * hold + 1, *starts.shape))
        states[0] = starts
        for i in range(nbatch):
            mujoco.mj_resetData(self.model, self.data)
            mujoco.mj_setState(self.model, self.data, starts[i], self.spec)
            for k in range(ncontrol * hold):
                self.data.ctrl[:] = control[i, k // hold]
                mujoco.mj_step(self.model, self.data)
                mujoco.mj_getState(self.model, self.data, states[k + 1, i], self.spec)
        if self.how == "rounding" and len(states) > 2:
            states[int(self.which) :, :, 1 : 1 + self.model.nq] *= 1 + 1e-15
        return states


def main(arguments: list[str]) -> None:
    """Say the version, or answer requests until there are no more."""
    if arguments == ["--version"]:
        print(f"v{VERSION}")
        return
    runner, descriptor = arguments[-2:]
    assert Path(runner).name == "runner.mjs"
    pretender = Pretender(os.environ.get(MISBEHAVIOUR, ""))
    connection = Connection(int(descriptor))
    with contextlib.suppress(EOFError):  # the end of the connection
        while True:
            request = json.loads(connection.recv_bytes())
            connection.send_bytes(pretender.answer(request.pop("action"), request).encode())
