"""Charts that can be laid out."""

import pytest

from mjbench.results import charts


def test_long_texts_do_not_reach_the_layout() -> None:
    part = {"data": {"values": [{"model": "x" * 10_000, "share": 0.5}]}, "title": "y" * 301}
    short = charts._shortened(part)
    assert len(short["title"]) == len(short["data"]["values"][0]["model"]) == 301
    assert short["data"]["values"][0]["share"] == 0.5


# Plots of a history have names that no other model's plot has, on any system.


def test_a_shipped_model_keeps_its_name() -> None:
    assert charts.file_name("humanoid") == "humanoid.svg"


@pytest.mark.parametrize("names", [("a b", "a-b"), ("~~~", "==="), ("A" * 300, "A" * 301)])
def test_names_that_look_alike_have_files_of_their_own(names: tuple[str, str]) -> None:
    one, other = map(charts.file_name, names)
    assert one != other
    assert max(len(one), len(other)) < 120


@pytest.mark.parametrize("name", ["CON", "nul", "com1"])
def test_no_plot_is_a_device(name: str) -> None:
    assert charts.file_name(name).removesuffix(".svg").upper() != name.upper()
