"""`mjbench models` and `mjbench paths`."""

import json
from pathlib import Path

from commands import mjbench


def test_models_lists_ours_with_their_facts(tmp_path: Path) -> None:
    done = mjbench("models", "--json", "-", cwd=tmp_path)
    assert done.returncode == 0
    rows = json.loads(done.stdout)["results"]
    assert len(rows) >= 10
    assert all(
        r["status"] == "ok" and r["facts"]["nv"] > 0 and r["facts"]["timestep"] > 0 for r in rows
    )


def test_paths_lists_what_is_available(tmp_path: Path) -> None:
    done = mjbench("paths", "--json", "-", cwd=tmp_path)
    assert done.returncode == 0
    rows = {r["path"]: r for r in json.loads(done.stdout)["results"]}
    assert rows["python_loop"]["closed_loop"] is True
    assert rows["rollout"]["closed_loop"] is False
    assert rows["python_loop"]["unavailable"] is None
    reasons = [r["unavailable"] for r in rows.values() if r["unavailable"] is not None]
    assert all(reasons)
