"""What lint says of Runge-Kutta in halves, and of an MjData that threads share."""

from pathlib import Path

import pytest
from linted import findings

RK4 = '''
XML = """<mujoco><option integrator="RK4"/></mujoco>"""
'''
HALVES = """
model = mujoco.MjModel.from_xml_string(XML)
data = mujoco.MjData(model)
{line}
for _ in range(9):
    mujoco.mj_step1(model, data)
    mujoco.mj_step2(model, data)
"""


@pytest.mark.parametrize(
    ("xml", "line"),
    [
        (RK4, ""),
        ("", "model.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4"),
        ("", "model.opt.integrator = int(mujoco.mjtIntegrator.mjINT_RK4)"),
    ],
)
def test_halves_of_a_runge_kutta_step_are_wrong_results(
    tmp_path: Path, xml: str, line: str
) -> None:
    (finding,) = findings(tmp_path, xml + HALVES.format(line=line), "MJB008")
    assert (finding.callee, finding.is_wrong_result) == ("mj_step2", True)


@pytest.mark.parametrize(
    ("xml", "line"),
    [
        ("", ""),
        (RK4.replace("RK4", "implicitfast"), ""),
        (RK4, "model.opt.integrator = mujoco.mjtIntegrator.mjINT_EULER"),
        (RK4.replace("XML", "OTHER"), ""),
        (RK4, "model = mujoco.MjModel.from_xml_path('robot.xml')"),
        ("", "other.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4"),
    ],
)
def test_halves_of_other_or_unknown_integrators_are_no_finding(
    tmp_path: Path, xml: str, line: str
) -> None:
    assert findings(tmp_path, xml + HALVES.format(line=line), "MJB008") == []


def test_whole_steps_of_runge_kutta_are_no_finding(tmp_path: Path) -> None:
    text = RK4 + HALVES.format(line="").replace("mj_step1", "mj_step").replace(
        "mj_step2", "mj_step"
    )
    assert findings(tmp_path, text, "MJB008") == []


THREADS = """
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
model = mujoco.MjModel.from_xml_string(XML)
data = mujoco.MjData(model)
def given(model, data):
    mujoco.mj_step(model, data)
def outer(i):
    mujoco.mj_step(model, data)
def own(i):
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data)
def locked(i):
    with lock:
        mujoco.mj_step(model, data)
pool = ThreadPoolExecutor(4)
processes = ProcessPoolExecutor()
one = ThreadPoolExecutor(max_workers=1)
{line}
"""


@pytest.mark.parametrize(
    ("line", "callee"),
    [
        ("for i in x: threading.Thread(target=given, args=(model, data)).start()", "Thread"),
        ("for i in x: threading.Thread(target=outer, args=(i,)).start()", "Thread"),
        ("t = [threading.Thread(target=given, args=(model, data)) for i in x]", "Thread"),
        ("for i in x: pool.submit(given, model, data)", "submit"),
        ("futures = [pool.submit(outer, i) for i in x]", "submit"),
        ("list(pool.map(outer, x))", "map"),
        ("with ThreadPoolExecutor() as p: p.map(outer, x)", "map"),
    ],
)
def test_one_mjdata_in_several_threads_is_a_wrong_result(
    tmp_path: Path, line: str, callee: str
) -> None:
    (finding,) = findings(tmp_path, THREADS.format(line=line), "MJB009")
    assert (finding.callee, finding.is_wrong_result) == (callee, True)


@pytest.mark.parametrize(
    "line",
    [
        "threading.Thread(target=given, args=(model, data)).start()",
        "for d in datas: threading.Thread(target=given, args=(model, d)).start()",
        "for i in x: threading.Thread(target=given, args=(model, mujoco.MjData(model))).start()",
        "for i in x:\n    data = mujoco.MjData(model)\n    pool.submit(given, model, data)",
        "for i in x:\n    t = threading.Thread(target=outer, args=x)\n    t.start()\n    t.join()",
        "for i in x: pool.submit(given, model, data).result()",
        "pool.map(own, x)",
        "pool.map(locked, x)",
        "processes.map(outer, x)",
        "one.map(outer, x)",
        "map(outer, x)",
        "for i in x: pool.submit(unknown, data)",
    ],
)
def test_an_mjdata_of_its_own_or_one_thread_at_a_time_is_no_finding(
    tmp_path: Path, line: str
) -> None:
    assert findings(tmp_path, THREADS.format(line=line), "MJB009") == []
