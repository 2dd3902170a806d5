"""Views that come out of a function of the script, and are stored by its caller."""

import pytest
from linted import findings, places

SCRIPT = """
model = mujoco.MjModel.from_xml_string(XML)
data = mujoco.MjData(model)
log, rows = [], {{}}
def look(data):
    {helper}
for i in range(9):
    mujoco.mj_step(model, data)
    {store}
"""
DICT = "return {'qpos': data.qpos, 'time': data.time}"
PAIR = "return data.time, data.qpos"


@pytest.mark.parametrize(
    ("helper", "store"),
    [
        ("return data.qpos", "log.append(look(data))"),
        ("return data.qpos[:3]", "rows[i] = look(data)"),
        (DICT, "log.append(look(data))"),
        (DICT, "for key, value in look(data).items(): rows[key].append(value)"),
        (DICT, "for value in look(data).values(): log.append(value)"),
        (DICT, "log.append(look(data)['qpos'])"),
        (DICT, "now = look(data); log.append(now)"),
        (DICT.replace("return", "r =") + "; return r", "log.append(look(data))"),
        ("return dict(q=data.qpos)", "log.append((i, look(data)))"),
        ("return data.qpos", "log.append(dict(q=look(data)))"),
        (PAIR, "time, q = look(data); log.append(q)"),
        ("return [data.qpos]", "log.append(look(data))"),
    ],
)
def test_a_view_of_a_helper_is_found_in_the_helper(helper: str, store: str) -> None:
    text = SCRIPT.format(helper=helper, store=store)
    assert places(text, "MJB001") == [("MJB001", helper)]


@pytest.mark.parametrize(
    ("helper", "store"),
    [
        ("return data.qpos.copy()", "log.append(look(data))"),
        ("return data.qpos[0]", "log.append(look(data))"),
        ("return np.concatenate([data.qpos, data.qvel])", "log.append(look(data))"),
        ("return data.ctrl", "log.append(look(data))"),
        ("return data.qpos", "x = look(data)[0]"),
        ("return data.qpos", "log.append(look(data).copy())"),
        ("return data.qpos", "log.append(look(data)); look(data)[:] = 0"),
        ("return data.qpos", "v = look(data); v[:] = 0; log.append(v)"),
        ("return data.qpos", "log.append(look(data)); np.copyto(look(data), 0)"),
        ("return data.qpos", "log.append(look(data)); look(data).fill(0)"),
        (DICT, "for key, value in look(data).items(): log.append(key)"),
        (DICT, "log.append(look(data)['time'])"),
        (PAIR, "time, q = look(data); log.append(time)"),
        ("data = mujoco.MjData(model); return data.qpos", "log.append(look(data))"),
        ("return data.qpos", "v = look(data) if i else 0; log.append(v)"),
        ("return data.qpos", "new = mujoco.MjData(model); log.append(look(new))"),
    ],
)
def test_a_copy_a_number_or_a_view_to_write_through_is_no_finding(helper: str, store: str) -> None:
    assert places(SCRIPT.format(helper=helper, store=store), "MJB001") == []


GENERATOR = """
def steps(model, data):
    for _ in range(9):
        mujoco.mj_step(model, data)
        yield data.time, data.qpos
{caller}
"""


@pytest.mark.parametrize(
    "caller",
    [
        "for time, q in steps(model, data): log.append(q)",
        "for i, row in enumerate(steps(model, data)): log.append(row)",
        "log = [q for _, q in steps(model, data)]",
    ],
)
def test_a_view_that_a_generator_yields_is_found_there(caller: str) -> None:
    text = GENERATOR.format(caller=caller)
    assert places(text, "MJB001") == [("MJB001", "yield data.time, data.qpos")]


def test_what_is_not_stored_of_a_generator_is_no_finding() -> None:
    for caller in (
        "for time, q in steps(model, data): log.append(time)",
        "for time, q in steps(model, data): total += q[0]",
        "log = [q.copy() for _, q in steps(model, data)]",
    ):
        assert places(GENERATOR.format(caller=caller), "MJB001") == []


def test_the_message_says_that_the_caller_stores_it() -> None:
    text = SCRIPT.format(helper="return data.qpos", store="log.append(look(data))")
    (finding,) = findings(text, "MJB001")
    assert finding.message.startswith("a view is returned, and the caller stores it")


def test_an_mjdata_of_the_episode_is_one_for_all_its_steps() -> None:
    text = """
    for episode in range(9):
        data = mujoco.MjData(model)
        for _ in range(9):
            mujoco.mj_step(model, data)
            log.append(data.qpos)
            if data.time > 1:
                ends.append(data.qpos)
                break
        ends.append(data.qvel)
    """
    assert places(text, "MJB001") == [("MJB001", "log.append(data.qpos)")]
