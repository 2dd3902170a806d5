"""What differs in the arguments of a function that JAX compiles again is named."""

import pytest

jax = pytest.importorskip("jax")
jnp = jax.numpy

from mjbench.commands.run.hook.argument_types import (  # noqa: E402
    DTYPE,
    SHAPE,
    VALUE,
    WEAK_TYPE,
    ArgumentTypes,
)


def scaled(state, factor=1.0, *, mode="plain"):
    return state


STATE = {"qpos": jnp.zeros(3, jnp.float32), "ctrl": jnp.zeros(2, jnp.float32)}


def changes_of(first, then):
    types = ArgumentTypes(scaled)
    assert types.note_compiled(*first) is None
    return types.note_compiled(*then)


@pytest.mark.parametrize(
    ("ctrl", "kind", "now"),
    [
        (jnp.full(2, 0.1), WEAK_TYPE, "weakly typed float32[2]"),
        (jnp.zeros(2, jnp.int32), DTYPE, "int32[2]"),
        (jnp.zeros((2, 1), jnp.float32), SHAPE, "float32[2,1]"),
        (None, VALUE, "absent"),
    ],
)
def test_the_field_that_differs_is_named_with_both_types(ctrl, kind, now):
    (change,) = changes_of(((STATE,), {}), (({**STATE, "ctrl": ctrl},), {}))
    assert change == ("state['ctrl']", kind, "float32[2]", now)


@pytest.mark.parametrize(
    ("more", "expected"),
    [
        ({"mode": "other"}, ("mode", VALUE, "'plain'", "'other'")),
        ({"mode": "plain", "factor": 3.0}, ("factor", VALUE, "2.0", "3.0")),
    ],
)
def test_a_value_that_may_be_static_is_named_where_no_type_differs(more, expected):
    first = (STATE,), {"mode": "plain", "factor": 2.0}
    assert changes_of(first, ((STATE,), {**first[1], **more})) == [expected]


def test_arguments_are_held_against_the_most_similar_ones_before():
    types, integer = ArgumentTypes(scaled), {name: x.astype(int) for name, x in STATE.items()}
    types.note_compiled((STATE,), {})
    assert len(types.note_compiled((integer,), {})) == 2
    (change,) = types.note_compiled(({**integer, "ctrl": STATE["ctrl"]},), {})
    assert change[0] in ("state['ctrl']", "state['qpos']")
    assert types.note_compiled((STATE,), {}) == []


def test_a_function_that_another_one_calls_while_jax_traces_it_compiles_nothing_itself():
    types = ArgumentTypes(scaled)
    types.note_compiled((STATE,), {})
    seen = []
    jax.make_jaxpr(lambda x: seen.append(types.note_compiled((x,), {})))(STATE)
    assert seen == [None]
