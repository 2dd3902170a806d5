"""What stacks show, from the libraries and files in them."""

import sysconfig

import pytest

from mjbench.program import activities
from mjbench.program.activities import Activity
from mjbench.program.hook import step_clock
from mjbench.program.py_spy import Frame

STANDARD = sysconfig.get_paths()["stdlib"]
SITE = "/env/lib/python3.11/site-packages"
OWN = Frame("main", "/home/user/train.py", 10)
CLOCK = Frame("call", step_clock.__file__, 100)
ENGINE = f"{SITE}/mujoco/libmujoco.so.4.0.0"
LIBC = "/usr/lib/libc.so.6"
NUMPY = f"{SITE}/numpy/_core/_multiarray_umath.cpython-311-x86_64-linux-gnu.so"


def library(function, file):
    return Frame(function, file, 0)


@pytest.mark.parametrize(
    ("frames", "activity"),
    [
        ([library("mj_solPrimal", ENGINE)], Activity.PHYSICS),
        ([CLOCK, library("mj_collision", ENGINE)], Activity.PHYSICS),
        ([CLOCK, library("memcpy", LIBC)], Activity.PHYSICS),
        ([CLOCK], Activity.BINDINGS),
        ([library("mjCModel::Compile", ENGINE)], Activity.LOADING),
        ([library("0x7f", f"{SITE}/mujoco/_structs.cpython-311.so")], Activity.BINDINGS),
        ([Frame("rollout", f"{SITE}/mujoco/rollout.py", 5)], Activity.PHYSICS),
        ([library("array_concatenate", NUMPY)], Activity.NUMPY),
        (
            [library("array_zeros", NUMPY), library("PyArray_NewFromDescr_int", NUMPY)],
            Activity.ALLOCATION,
        ),
        ([Frame("forward", f"{SITE}/torch/nn/modules/linear.py", 5)], Activity.POLICY),
        (
            [Frame("render", f"{SITE}/mujoco/rendering/classic/renderer.py", 200)],
            Activity.RENDERING,
        ),
        ([library("0x1", "/usr/lib/libgallium-24.so")], Activity.RENDERING),
        (
            [
                Frame("render", f"{SITE}/mujoco/rendering/classic/renderer.py", 200),
                library("renderGeom", ENGINE),
            ],
            Activity.RENDERING,
        ),
        (
            [
                Frame("step", f"{SITE}/torchrl/envs/common.py", 5),
                Frame("call", f"{SITE}/torch/autograd/grad_mode.py", 5),
                library("mj_collision", ENGINE),
            ],
            Activity.PHYSICS,
        ),
        ([Frame("pinv", f"{SITE}/numpy/linalg/_linalg.py", 2100)], Activity.NUMPY),
        ([Frame("emit", f"{STANDARD}/logging/__init__.py", 1100)], Activity.LOGGING),
        ([library("write", LIBC)], Activity.LOGGING),
        (
            [
                Frame("_recv", f"{STANDARD}/multiprocessing/connection.py", 384),
                library("read", LIBC),
            ],
            Activity.PROCESSES,
        ),
        (
            [
                Frame("get", f"{STANDARD}/multiprocessing/pool.py", 765),
                Frame("wait", f"{STANDARD}/threading.py", 320),
            ],
            Activity.PROCESSES,
        ),
        ([Frame("wait", f"{STANDARD}/threading.py", 320)], Activity.THREADS),
        ([library("clock_nanosleep", LIBC)], Activity.SLEEPING),
        ([library("gc_collect_main", "/usr/lib/libpython3.11.so.1.0")], Activity.COLLECTION),
        ([Frame("_load", "<frozen importlib._bootstrap>", 690)], Activity.IMPORT),
        (
            [
                Frame("_load", "<frozen importlib._bootstrap>", 690),
                Frame("<module>", f"{SITE}/glfw/library.py", 20),
                Frame("run", f"{STANDARD}/subprocess.py", 550),
            ],
            Activity.IMPORT,
        ),
        ([library("list_sort", "/usr/lib/libpython3.11.so.1.0")], Activity.PYTHON),
        ([], Activity.PYTHON),
        ([library("memcpy", LIBC)], None),
    ],
)
def test_activity_of_a_stack(frames, activity):
    assert activities.activity([OWN, *frames]) == activity


def test_collection_counts_wherever_it_happens():
    stack = [OWN, Frame("forward", f"{SITE}/torch/x.py", 5), library("gc_collect_main", "python")]
    assert activities.activity(stack) == Activity.COLLECTION


def test_callers_of_the_users_own_line_do_not_count():
    decorator = Frame("call", f"{SITE}/torch/autograd/grad_mode.py", 5)
    assert activities.activity([decorator, OWN]) == Activity.PYTHON
    assert activities.activity([Frame("_load", "<frozen importlib._bootstrap>", 690), OWN]) == (
        Activity.PYTHON
    )


def test_the_timer_of_the_python_package_is_seen():
    stack = [OWN, CLOCK, library("0x7f", "[vdso]")]
    assert activities.activity(stack) == Activity.PHYSICS
    assert activities.is_engine_clock(stack)
    assert not activities.is_engine_clock([OWN, CLOCK, library("mj_step", ENGINE)])


def test_paths_are_shown_short(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    activities.shown_path.cache_clear()
    assert activities.shown_path(str(tmp_path / "a" / "train.py")) == "a/train.py"
    assert activities.shown_path(f"{SITE}/gymnasium/core.py") == "gymnasium/core.py"
    assert activities.shown_path(f"{STANDARD}/json/decoder.py") == "json/decoder.py"
    assert activities.shown_path("/elsewhere/train.py") == "/elsewhere/train.py"


def test_lines_of_compiled_sources_are_no_python():
    assert not Frame("f", "Modules/_struct.c", 12).is_python


def test_without_stacks_of_libraries_a_line_that_steps_is_physics(tmp_path):
    script = tmp_path / "loop.py"
    script.write_text("x = 1\nmujoco.mj_step(model, data)\n")
    steps, other = (Frame("main", str(script), line) for line in (2, 1))
    assert activities.activity([OWN, CLOCK], has_native=False) == Activity.PHYSICS
    assert activities.activity([steps], has_native=False) == Activity.PHYSICS
    assert activities.activity([steps]) == Activity.PYTHON
    assert activities.activity([other], has_native=False) == Activity.PYTHON


def test_elements_of_a_model_are_built_whatever_builds_them():
    mjcf = Frame("__init__", "/env/lib/python3.11/site-packages/dm_control/mjcf/element.py", 205)
    physics = Frame("bind", "/env/lib/python3.11/site-packages/dm_control/mjcf/physics.py", 500)
    assert activities.activity([OWN, mjcf], has_native=False) == Activity.BUILDING
    assert activities.activity([OWN, physics], has_native=False) == Activity.PYTHON
