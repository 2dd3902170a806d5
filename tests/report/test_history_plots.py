"""Plots of a history have names that no other model's plot has, on any system."""

import pytest

from mjbench.report import history_plots


def test_a_shipped_model_keeps_its_name() -> None:
    assert history_plots.file_name("humanoid") == "humanoid.svg"


@pytest.mark.parametrize("names", [("a b", "a-b"), ("~~~", "==="), ("A" * 300, "A" * 301)])
def test_names_that_look_alike_have_files_of_their_own(names: tuple[str, str]) -> None:
    one, other = map(history_plots.file_name, names)
    assert one != other
    assert max(len(one), len(other)) < 120


@pytest.mark.parametrize("name", ["CON", "nul", "com1"])
def test_no_plot_is_a_device(name: str) -> None:
    assert history_plots.file_name(name).removesuffix(".svg").upper() != name.upper()
