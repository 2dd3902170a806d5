"""The names of settings on the command line, and their groups."""

import pytest

from mjbench.commands.tune import setting_names
from mjbench.commands.tune.knobs import KNOBS
from mjbench.errors import InputError


def test_every_knob_is_in_one_group():
    assert sorted(setting_names.NAMES) == sorted(knob.name for knob in KNOBS)


def test_a_group_stands_for_its_settings():
    assert setting_names.chosen(["integration"], []) == ("timestep", "integrator", "eulerdamp")
    assert set(setting_names.chosen(["solver"], [])) > {"solver", "iterations", "jacobian"}


def test_what_is_skipped_is_left_out_of_all_or_of_what_is_named():
    left = setting_names.chosen([], ["timestep"])
    assert set(setting_names.NAMES) - set(left) == {"timestep"}
    assert setting_names.chosen(["integration"], ["timestep"]) == ("integrator", "eulerdamp")


def test_what_names_nothing_is_refused():
    with pytest.raises(
        InputError, match=r"no setting timestp \(did you mean timestep, timer\?\): see"
    ):
        setting_names.chosen(["timestp"], [])
    with pytest.raises(InputError, match="no setting is left"):
        setting_names.chosen(["timestep"], ["integration"])
