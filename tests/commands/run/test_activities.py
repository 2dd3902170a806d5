"""What stacks show, from the files and lines in them."""

import sysconfig

import pytest

from mjbench.commands.run import activities
from mjbench.commands.run.activities import Activity
from mjbench.commands.run.hook import step_clock
from mjbench.commands.run.py_spy import Frame

STANDARD = sysconfig.get_paths()["stdlib"]
SITE = "/env/lib/python3.11/site-packages"
OWN = Frame("main", "/home/user/train.py", 10)
CLOCK = Frame("call", step_clock.__file__, 100)


@pytest.mark.parametrize(
    ("frames", "activity"),
    [
        ([CLOCK], Activity.PHYSICS),
        ([Frame("rollout", f"{SITE}/mujoco/rollout.py", 5)], Activity.PHYSICS),
        ([Frame("forward", f"{SITE}/torch/nn/modules/linear.py", 5)], Activity.POLICY),
        (
            [Frame("render", f"{SITE}/mujoco/rendering/classic/renderer.py", 200)],
            Activity.RENDERING,
        ),
        ([Frame("pinv", f"{SITE}/numpy/linalg/_linalg.py", 2100)], Activity.NUMPY),
        ([Frame("emit", f"{STANDARD}/logging/__init__.py", 1100)], Activity.LOGGING),
        ([Frame("_recv", f"{STANDARD}/multiprocessing/connection.py", 384)], Activity.PROCESSES),
        (
            [
                Frame("get", f"{STANDARD}/multiprocessing/pool.py", 765),
                Frame("wait", f"{STANDARD}/threading.py", 320),
            ],
            Activity.PROCESSES,
        ),
        ([Frame("wait", f"{STANDARD}/threading.py", 320)], Activity.THREADS),
        ([Frame("_load", "<frozen importlib._bootstrap>", 690)], Activity.IMPORT),
        (
            [
                Frame("_load", "<frozen importlib._bootstrap>", 690),
                Frame("<module>", f"{SITE}/glfw/library.py", 20),
                Frame("run", f"{STANDARD}/subprocess.py", 550),
            ],
            Activity.IMPORT,
        ),
        ([], Activity.PYTHON),
    ],
)
def test_activity_of_a_stack(frames, activity):
    assert activities.activity([OWN, *frames]) == activity


def test_callers_of_the_users_own_line_do_not_count():
    decorator = Frame("call", f"{SITE}/torch/autograd/grad_mode.py", 5)
    assert activities.activity([decorator, OWN]) == Activity.PYTHON
    assert activities.activity([Frame("_load", "<frozen importlib._bootstrap>", 690), OWN]) == (
        Activity.PYTHON
    )


def test_paths_are_shown_short(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    activities.shown_path.cache_clear()
    assert activities.shown_path(str(tmp_path / "a" / "train.py")) == "a/train.py"
    assert activities.shown_path(f"{SITE}/gymnasium/core.py") == "gymnasium/core.py"
    assert activities.shown_path(f"{STANDARD}/json/decoder.py") == "json/decoder.py"
    assert activities.shown_path("/elsewhere/train.py") == "/elsewhere/train.py"


def test_a_line_that_steps_is_physics(tmp_path):
    script = tmp_path / "loop.py"
    script.write_text("x = 1\nmujoco.mj_step(model, data)\n")
    steps, other = (Frame("main", str(script), line) for line in (2, 1))
    assert activities.activity([steps]) == Activity.PHYSICS
    assert activities.activity([other]) == Activity.PYTHON


def test_elements_of_a_model_are_built_whatever_builds_them():
    mjcf = Frame("__init__", "/env/lib/python3.11/site-packages/dm_control/mjcf/element.py", 205)
    physics = Frame("bind", "/env/lib/python3.11/site-packages/dm_control/mjcf/physics.py", 500)
    assert activities.activity([OWN, mjcf]) == Activity.BUILDING
    assert activities.activity([OWN, physics]) == Activity.PYTHON
