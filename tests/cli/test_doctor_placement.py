"""`mjbench doctor --placement` as a user types it."""

import json
from pathlib import Path

from commands import mjbench

WORDS = ("doctor", "--placement", "contact.xml", "broken.xml", "--time-limit", "0.1s")


def test_a_model_is_measured_and_stored_and_not_measured_again(
    tmp_path: Path, contact_file: str
) -> None:
    (tmp_path / "broken.xml").write_text("<mujoco><nothing/></mujoco>")
    done = mjbench(*WORDS, "--json", "out.json", cwd=tmp_path)
    assert done.returncode == 2, done.stderr
    assert "contact.xml, MuJoCo " in done.stdout
    rows = json.loads((tmp_path / "out.json").read_text())["results"]
    assert [(row["model"], row["status"]) for row in rows] == [
        ("contact.xml", "ok"),
        ("broken.xml", "input"),
    ]
    assert "a spread needs at least 36 launches: give --budget" in rows[0]["detail"]
    launches = [residue["launches"] for residue in rows[0]["residues"]]
    assert launches in ([1], [1, 1]), "one, or two at the same time on other residues"
    assert "MuJoCo cannot load it" in rows[1]["detail"]
    (file,) = (tmp_path / "results/runs").glob("*.jsonl")
    _, record, _ = map(json.loads, file.read_text().splitlines())
    assert record["type"] == "placement"
    placements = [sample["placements"] for sample in record["samples"]]
    assert {placement["old"] for placement in placements} == {None}
    residues = sorted(placement["new"]["engine_bytes"] % 64 for placement in placements)
    assert residues == [residue["residue"] for residue in rows[0]["residues"]]
    again = mjbench(*WORDS, "--json", "again.json", "--resume", str(file), cwd=tmp_path)
    assert again.returncode == 2
    assert json.loads((tmp_path / "again.json").read_text())["results"] == rows
    shown = mjbench("show", str(file), "--json", "shown.json", cwd=tmp_path)
    assert shown.returncode == 0
    assert json.loads((tmp_path / "shown.json").read_text())["results"] == rows


def test_an_unknown_release_is_bad_input(tmp_path: Path) -> None:
    done = mjbench("doctor", "--placement", "cartpole", "--release", "tea", cwd=tmp_path)
    assert done.returncode == 2
    assert "'tea' is not a release" in done.stderr
