"""mjbench in programs of a user's: a script, `python -c`, a notebook, and Ctrl-C in one."""

import signal
from pathlib import Path

import pytest
from commands import ROOT, python, started

# No `if __name__ == "__main__"`: child processes must not import the script.
SCRIPT = """
import mjbench
import process_tree

print("begins")
compared = mjbench.compare(
    "cartpole", paths="processes", threads=2, nbatch=4, nstep=4, budget_s=0.1
)
print(sorted({result.status.value for result in compared.results}))
print(process_tree.descendants())
"""
LONG = """
import threading
import mjbench
import process_tree
from mjbench.host import machine

latency = mjbench.latency
machine.describe()  # both start processes, too

def say_when_it_steps():
    while not process_tree.descendants():
        pass
    print("steps", flush=True)

threading.Thread(target=say_when_it_steps).start()
try:
    latency("cartpole", nstep=10_000_000)
except KeyboardInterrupt:
    print("interrupted", process_tree.descendants())
"""


def test_a_script_needs_no_guard_and_is_left_without_processes(tmp_path: Path) -> None:
    (tmp_path / "script.py").write_text(SCRIPT)
    done = python("script.py", cwd=tmp_path)
    assert done.stdout == "begins\n['ok']\nset()\n", done.stderr
    assert {file.name for file in tmp_path.iterdir()} == {"script.py"}


def test_it_runs_from_a_command_line_of_python(tmp_path: Path) -> None:
    program = "import mjbench; print(repr(mjbench.latency('cartpole', nstep=50)))"
    done = python("-c", program, cwd=tmp_path)
    assert done.stdout.startswith("<mjbench Latency: cartpole, "), done.stderr


def test_an_error_is_one_line_below_its_traceback(tmp_path: Path) -> None:
    done = python("-c", "import mjbench; mjbench.profile('cartpol')", cwd=tmp_path)
    last = done.stderr.strip().splitlines()[-1]
    assert last.startswith("mjbench.simulation.models.UnknownModelError: no model 'cartpol'")


def test_importing_is_cheap_and_a_timer_needs_only_the_standard_library(tmp_path: Path) -> None:
    program = (
        "import sys, mjbench\n"
        "with mjbench.timer(steps=3) as timer: pass\n"
        "str(timer), repr(timer), timer._repr_html_()\n"
        "print({'numpy', 'mujoco', 'rich', 'scipy', 'msgspec'} & set(sys.modules))"
    )
    assert python("-c", program, cwd=tmp_path).stdout == "set()\n"


def test_ctrl_c_leaves_no_process(tmp_path: Path) -> None:
    with started("-c", LONG, cwd=tmp_path, stderr=None, start_new_session=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "steps\n"
        process.send_signal(signal.SIGINT)
        assert process.stdout.read() == "interrupted set()\n"
    assert process.returncode == 0


def test_a_notebook_shows_conclusions_and_tables(tmp_path: Path) -> None:
    nbclient = pytest.importorskip("nbclient", reason="needs nbclient and ipykernel")
    pytest.importorskip("ipykernel", reason="needs nbclient and ipykernel")
    import nbformat

    cells = [
        f"import sys; sys.path[:0] = [{str(ROOT)!r}]; import mjbench",
        "mjbench.profile('cartpole')",
        "timer = mjbench.timer(steps=3)\nwith timer: pass\ntimer",
        "import psutil; print(psutil.Process().children())",
    ]
    notebook = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(cell) for cell in cells])
    client = nbclient.NotebookClient(
        notebook, timeout=120, resources={"metadata": {"path": tmp_path}}
    )
    client.execute()
    outputs = [list(cell.outputs) for cell in notebook.cells]
    (profiled,) = outputs[1]
    text = profiled["data"]["text/markdown"]
    assert text.index("a step of a Python loop takes") < text.index("|---")
    assert "kinematics" in profiled["data"]["text/plain"]
    assert "3 steps" in outputs[2][0]["data"]["text/html"]
    assert outputs[3][0]["text"] == "[]\n"
