"""Which function belongs to which layer."""

import pytest

from mjbench.commands.env.layers import Layer, layer_of


@pytest.mark.parametrize(
    ("function", "results", "layer"),
    [
        ("_get_obs", (), Layer.OBSERVATION),
        ("_update_observables", (), Layer.OBSERVATION),
        ("get_reward", (), Layer.REWARD),
        ("control_cost", (), Layer.REWARD),
        ("_get_reset_info", (), Layer.INFO),
        ("get_termination", (), Layer.TERMINATION),
        ("do_simulation", (), Layer.STEPPING),
        ("step2", (), Layer.STEPPING),
        ("_pre_action", (), Layer.ACTION),
        ("before_step", (), Layer.ACTION),
        ("set_xyz_action", (), Layer.ACTION),
        ("render", (), Layer.RENDERING),
        ("mass_center", ("position",), Layer.REST),
        ("score", ("reward",), Layer.REWARD),
        ("sense", ("observation",), Layer.OBSERVATION),
        ("sense", ("_last_stable_obs",), Layer.REST),
        ("_post_action", ("reward", "done", "info"), Layer.INFO),
        ("after_step", (), Layer.REST),
        ("summary", ("info",), Layer.INFO),
        ("has_fallen", ("terminated",), Layer.TERMINATION),
    ],
)
def test_a_function_is_known_by_its_name_or_its_result(
    function: str, results: tuple[str, ...], layer: Layer
) -> None:
    assert layer_of(function, results) == layer
