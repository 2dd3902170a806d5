"""`mjbench profile --habits` as a user types it."""

import json
from pathlib import Path

from commands import mjbench


def test_a_model_that_does_not_load_costs_its_row(tmp_path: Path, inline: None) -> None:
    (tmp_path / "broken.xml").write_text("<mujoco><nothing/></mujoco>")
    done = mjbench("profile", "--habits", "broken.xml", "--json", "out.json", cwd=tmp_path)
    assert done.returncode == 2
    assert "mjbench: broken.xml: MuJoCo cannot load it" in done.stderr
    document = json.loads((tmp_path / "out.json").read_text())
    (row,) = document["results"]
    assert (document["schema"], row["model"], row["status"]) == (1, "broken.xml", "input")
    assert row["costs"] is None
