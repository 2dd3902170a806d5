"""Targets as a user writes them."""

from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mjbench.errors import InputError
from mjbench.paired import targets
from mjbench.simulation import model_options


def test_a_model_or_path_that_one_target_leaves_out_is_the_others() -> None:
    baseline, candidate = targets.parse("humanoid,solver=newton", "path=rollout,solver=cg")
    assert baseline.model == candidate.model
    assert baseline.model.name == "humanoid"
    assert (baseline.path, candidate.path) == ("rollout", "rollout")
    assert dict(baseline.model_options) == {"solver": "newton"}
    assert dict(candidate.model_options) == {"solver": "cg"}


@pytest.mark.parametrize("baseline", ["pile,path=rollout", "path=rollout,model=pile"])
def test_a_side_that_names_a_model_needs_no_key(baseline: str) -> None:
    old, new = targets.parse(baseline, "cloth")
    assert (old.model.name, new.model.name) == ("pile", "cloth")
    assert old.path == new.path == "rollout"


def test_a_file_is_a_model_whatever_its_name(tmp_path: Path) -> None:
    file = tmp_path / "solver=cg.xml"
    file.write_text("<mujoco/>")
    baseline, candidate = targets.parse(f"{file},solver=cg", "model=cartpole")
    assert (baseline.model.path, candidate.model.name) == (file, "cartpole")
    file = file.rename(tmp_path / "a,b.xml")
    assert targets.parse(str(file), "cartpole")[0].model.path == file


def test_a_model_that_both_targets_leave_out_is_bad_input() -> None:
    with pytest.raises(InputError, match=r"^name a model, one of cartpole, .*, a path to \.xml"):
        targets.parse("path=rollout", "path=batch_rollout")


def test_defaults_are_a_python_loop_in_the_installed_release() -> None:
    baseline, candidate = targets.parse("cartpole", "iterations=5")
    assert (baseline.path, baseline.release.name) == ("python_loop", "installed")
    assert baseline.release == candidate.release
    assert baseline.row().options == candidate.row().options == {}


def test_options_of_a_path_are_parsed_and_completed() -> None:
    baseline, candidate = targets.parse("pile,path=rollout,threads=2", "path=rollout")
    assert baseline.options["threads"] == baseline.nthread == 2
    assert candidate.options["threads"] == candidate.nthread == 1


def test_any_path_can_step_without_the_timer() -> None:
    baseline, candidate = targets.parse("pile", "path=rollout,threads=2,timer=off")
    assert baseline.has_timer
    assert not candidate.has_timer
    assert not candidate.row().has_timer
    with pytest.raises(InputError, match="timer is on or off"):
        targets.parse("timer=maybe", "pile")


def test_option_names_a_field_of_mjoption_too() -> None:
    _, candidate = targets.parse("pile", "option=solver:cg")
    assert dict(candidate.model_options) == {"solver": "cg"}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "humanid",
            r"no model 'humanid' \(did you mean humanoid\?\).*; a setting is KEY=VALUE, such as",
        ),
        ("origin/main", "no such file: origin/main; .* two revisions need a function after them"),
        ("pile,cloth", "'pile,cloth': model is given twice"),
        ("no.xml", "no such file: no.xml$"),
        ("3.5.0", "a release is release=3.5.0; `mjbench versions` compares releases"),
        ("=2", "'=2' is not KEY=VALUE"),
        ("solver=", "'solver=' is not KEY=VALUE"),
        ("speed=1", "no 'speed'; path python_loop has clock"),
        ("path=nothing", "no path 'nothing'"),
        ("path=rollout,threads=none", "threads"),
        ("path=mjx", "cannot alternate"),
        ("path=rollout,threads=100000", "at least 1 and at most 1024"),
        ("path=rollout,chunk=1e3", "chunk"),
        ("timestep=0", "'timestep=0': option timestep: '0' is not a number from 1e-15"),
        ("solver=cg,iterations=-5", "'-5' is not a whole number from 0"),
        ("solver=cg,solver=newton", "solver is given twice"),
        (
            "mujoco==9.9.9",
            "'mujoco==9.9.9': a release is release=mujoco==9.9.9; `mjbench versions`",
        ),
    ],
)
def test_a_target_that_means_nothing_is_bad_input(text: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        targets.parse(text, "cartpole")


KEYS = st.sampled_from(
    [
        "model",
        "path",
        "release",
        "threads",
        "chunk",
        "pool",
        "data",
        "option",
        *model_options.FIELDS,
    ]
)
VALUES = st.one_of(
    st.text(max_size=8),
    st.floats().map(str),
    st.integers().map(str),
    st.sampled_from(["rollout", "threads", "humanoid", "cg", "solver:cg", "3.3.0", "~nobody"]),
)
SETTINGS = st.lists(st.tuples(KEYS, VALUES).map("=".join), max_size=3).map(",".join)


@settings(deadline=None)
@given(baseline=st.one_of(SETTINGS, st.text(max_size=12)), candidate=SETTINGS)
def test_any_text_is_two_targets_or_bad_input(baseline: str, candidate: str) -> None:
    try:
        pair = targets.parse(baseline, candidate)
    except InputError as error:
        assert "\n" not in str(error)
        return
    for target in pair:
        assert 1 <= target.nthread <= 1024
        for field, value in target.model_options.items():
            model_options.check(field, value)
