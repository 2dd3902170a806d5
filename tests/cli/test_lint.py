"""`mjbench lint` as a user types it."""

import json
from pathlib import Path

from commands import mjbench

LOOP = """
import mujoco

data = mujoco.MjData(model)
log = []
for i in range(100):
    mujoco.mj_step(model, data)
    log.append({value})
"""


def test_it_prints_like_a_linter_and_exits_1(tmp_path: Path) -> None:
    (tmp_path / "bad.py").write_text(LOOP.format(value="data.qpos"))
    done = mjbench("lint", "bad.py", "--json", "out.json", cwd=tmp_path)
    assert done.returncode == 1
    assert done.stdout.startswith("bad.py:8:16 MJB001 a view is stored")
    (finding,) = json.loads((tmp_path / "out.json").read_text())["findings"]
    assert set(finding) == {"file", "line", "col", "code", "message", "ns_per_step"}


def test_a_clean_folder_exits_0_and_a_missing_file_is_bad_input(tmp_path: Path) -> None:
    (tmp_path / "good.py").write_text(LOOP.format(value="data.qpos.copy()"))
    assert mjbench("lint", ".", cwd=tmp_path).returncode == 0
    done = mjbench("lint", "missing.py", cwd=tmp_path)
    assert done.returncode == 2
    assert "no such file" in done.stderr


def test_a_file_that_is_not_python_is_reported_after_the_findings_of_others(tmp_path: Path) -> None:
    (tmp_path / "bad.py").write_text(LOOP.format(value="data.qpos"))
    (tmp_path / "broken.py").write_text("def (")
    done = mjbench("lint", ".", cwd=tmp_path)
    assert done.returncode == 2
    assert "MJB001" in done.stdout
    assert "broken.py" in done.stderr
