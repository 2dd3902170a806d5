"""Samples as a flame graph."""

import json
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest

from mjbench.errors import InputError
from mjbench.program.py_spy import Frame, Thread, ThreadSamples
from mjbench.report import flame

MAIN = Frame("main", "/home/me/train.py", 3)
STEP = Frame("step", "/home/me/train.py", 9)
ENGINE = Frame("<mj_step>", "/lib/libmujoco.so", 0)


def threads() -> list[ThreadSamples]:
    stacks = [[MAIN, STEP, ENGINE]] * 3 + [[MAIN]]
    return [ThreadSamples(Thread(1, 1, "MainThread"), stacks, 0.25)]


def test_widths_of_a_picture_are_shares_of_the_time(tmp_path: Path) -> None:
    file = tmp_path / "flame.svg"
    flame.write(file, threads())
    root = ET.parse(file).getroot()
    boxes = {
        group[0].text.split(" (")[0].split(":")[0]: float(group[1].get("width")) for group in root
    }
    assert boxes == {"all threads": 1200, "main": 1200, "step": 900, "<mj_step>": 900}


def test_a_picture_of_nothing_is_a_picture(tmp_path: Path) -> None:
    file = tmp_path / "flame.svg"
    flame.write(file, [])
    assert ET.parse(file).getroot().tag.endswith("svg")


def test_a_profile_has_the_stacks_with_their_time(tmp_path: Path) -> None:
    file = tmp_path / "profile.json"
    flame.write(file, threads())
    profile = json.loads(file.read_text())
    (sampled,) = profile["profiles"]
    assert sampled["samples"] == [[0, 1, 2]] * 3 + [[0]]
    assert sampled["endValue"] == sum(sampled["weights"]) == 1.0
    assert profile["shared"]["frames"][1] == {"name": "step", "file": STEP.file, "line": 9}


def test_a_file_of_another_kind_is_refused_before_the_program_runs() -> None:
    with pytest.raises(InputError, match=r"\.svg or \.json"):
        flame.check(Path("flame.png"))
    flame.check(Path("flame.svg"))
