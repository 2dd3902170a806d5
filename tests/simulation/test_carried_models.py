"""Models from another machine have the names that they have there."""

from pathlib import Path

import pytest
from example_models import CONTACT_XML

from mjbench.simulation import carried_models, models


@pytest.fixture
def listed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    file = tmp_path / "0/robot.xml"
    file.parent.mkdir()
    file.write_text(CONTACT_XML)
    carried_models.write(tmp_path / "models.json", {"~/robots/robot.xml": file, "cartpole": file})
    monkeypatch.setenv(carried_models.VARIABLE, str(tmp_path / "models.json"))
    return file


@pytest.mark.parametrize("name", ["~/robots/robot.xml", "cartpole"])
def test_a_carried_model_is_found_by_its_name(listed: Path, name: str) -> None:
    assert models.resolve(name) == models.ModelSource(name, listed)


def test_other_names_are_what_they_always_are(listed: Path) -> None:
    assert models.resolve("pile").path == models.shipped_folder() / "pile.xml"


@pytest.mark.parametrize("text", ["", "no JSON", "[1]", '{"pile": 3}'])
def test_a_list_that_is_damaged_is_left_alone(
    listed: Path, monkeypatch: pytest.MonkeyPatch, text: str
) -> None:
    (listed.parents[1] / "models.json").write_text(text)
    assert models.resolve("pile").path == models.shipped_folder() / "pile.xml"


def test_without_a_list_there_is_no_carried_model(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(carried_models.VARIABLE, raising=False)
    assert carried_models.find("pile") is None
