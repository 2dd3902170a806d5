"""What the words of a command line select."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mjbench import paths
from mjbench.errors import InputError
from mjbench.verification import selection


def test_words_stand_for_several_paths() -> None:
    c_paths = selection.expand(["c"])
    assert "rollout" in c_paths
    assert "mjx" not in c_paths
    assert selection.expand(["mjx", "c", "rollout"]) == ["mjx", *c_paths]


def test_a_sweep_of_accelerated_paths_alone_gets_rivals() -> None:
    assert "rollout" in selection.rivals(["mjx"])
    assert selection.rivals(["mjx", "rollout"]) == []
    assert selection.rivals(["rollout"]) == []


def test_the_base_path_comes_first_and_is_added() -> None:
    assert [v.path for v in selection.variants(["rollout"], [1])] == [paths.BASE, "rollout"]


def test_python_threads_are_tried_with_the_most_alone_unless_asked() -> None:
    (default,) = [v for v in selection.variants(["threads"]) if v.path == "threads"]
    assert default.options["threads"] == max(selection.default_threads())
    options = [v.options for v in selection.variants(["threads"], [2, 3]) if v.path == "threads"]
    assert options == [{"threads": 2}, {"threads": 3}]


def test_option_values_are_parsed_by_their_option() -> None:
    assert selection.choices(["pool=new,kept", "chunk=4"], []) == {
        "pool": ["new", "kept"],
        "chunk": [4],
    }
    for word in ("pool=warm", "colour=red", "pool"):
        with pytest.raises(InputError):
            selection.choices([word], [])


def test_an_option_that_would_be_ignored_is_bad_input() -> None:
    with pytest.raises(InputError, match="with --threads"):
        selection.choices(["threads=2"], [])
    with pytest.raises(InputError, match="pool is given twice"):
        selection.choices(["pool=new", "pool=kept"], [])


@settings(deadline=None)
@given(
    argument=st.one_of(
        st.text(max_size=12),
        st.tuples(
            st.sampled_from(["pool", "chunk", "threads", "data", "stage"]),
            st.one_of(st.text(max_size=8), st.integers().map(str), st.floats().map(str)),
        ).map("=".join),
    )
)
def test_any_text_is_option_values_or_bad_input(argument: str) -> None:
    try:
        values_by_name = selection.choices([argument], [])
    except InputError as error:
        assert "\n" not in str(error)
        return
    for values in values_by_name.values():
        assert values
        assert all(isinstance(value, str) or 1 <= value < 2**31 for value in values)


@settings(deadline=None)
@given(names=st.lists(st.one_of(st.text(max_size=12), st.sampled_from(["c", "mjx"])), max_size=3))
def test_any_names_are_variants_or_bad_input(names: list[str]) -> None:
    try:
        variants = selection.variants(names, [1])
    except InputError as error:
        assert "\n" not in str(error)
        return
    assert variants[0].path == paths.BASE


def test_a_path_of_the_users_own_whose_variants_fail_is_bad_input() -> None:
    with pytest.raises(InputError, match="VariantsRaise: RuntimeError: no variants"):
        selection.variants(["wrong_paths:VariantsRaise"])
