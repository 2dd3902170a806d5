"""What differs in the arguments of a function that JAX compiles again is named.

A process of its own uses JAX: one that has started threads of JAX can no longer fork.
"""

import importlib.util
import json
import subprocess
import sys

import pytest

from mjbench.commands.run.hook.argument_types import DEVICE, DTYPE, SHAPE, VALUE, WEAK_TYPE

PROGRAM = """
import json

import jax
import jax.numpy as jnp

from mjbench.commands.run.hook.argument_types import ArgumentTypes


def scaled(state, factor=1.0, *, mode="plain"):
    return state


def changes_of(*calls):
    types = ArgumentTypes(scaled)
    return [types.note_compiled(*call) for call in calls]


STATE = {"qpos": jnp.zeros(3, jnp.float32), "ctrl": jnp.zeros(2, jnp.float32)}
INTEGER = {name: x.astype(int) for name, x in STATE.items()}
FIELDS = {
    "weak type": jnp.full(2, 0.1),
    "dtype": jnp.zeros(2, jnp.int32),
    "shape": jnp.zeros((2, 1), jnp.float32),
    "device": jax.device_put(jnp.full(2, 0.1), jax.devices()[0]),
    "value": None,
}
noted = {
    name: changes_of(((STATE,), {}), (({**STATE, "ctrl": ctrl},), {}))
    for name, ctrl in FIELDS.items()
}
usual = {"mode": "plain", "factor": 2.0}
for name, value in (("mode", "other"), ("factor", 3.0)):
    noted[name] = changes_of(((STATE,), usual), ((STATE,), {**usual, name: value}))
noted["similar"] = changes_of(
    ((STATE,), {}), ((INTEGER,), {}), (({**INTEGER, "ctrl": STATE["ctrl"]},), {}), ((STATE,), {})
)
types, traced = ArgumentTypes(scaled), []
types.note_compiled((STATE,), {})
jax.make_jaxpr(lambda x: traced.append(types.note_compiled((x,), {})))(STATE)
noted["traced"] = traced
print(json.dumps(noted))
"""


@pytest.fixture(scope="module")
def changes():
    """What the program notes at each compilation of a function, by the kind of its calls."""
    if importlib.util.find_spec("jax") is None:
        pytest.skip("JAX is not installed")
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM], capture_output=True, text=True, check=True
    )
    return json.loads(done.stdout)


@pytest.mark.parametrize(
    ("kind", "now"),
    [
        (WEAK_TYPE, "weakly typed float32[2]"),
        (DTYPE, "int32[2]"),
        (SHAPE, "float32[2,1]"),
        (VALUE, "absent"),
    ],
)
def test_the_field_that_differs_is_named_with_both_types(changes, kind, now):
    assert changes[kind] == [None, [["state['ctrl']", kind, "float32[2]", now]]]


def test_an_array_that_is_committed_to_a_device_is_of_another_type(changes):
    now = "weakly typed committed float32[2]"
    assert changes[DEVICE] == [None, [["state['ctrl']", DEVICE, "uncommitted float32[2]", now]]]


@pytest.mark.parametrize(
    ("name", "values"), [("mode", ["'plain'", "'other'"]), ("factor", ["2.0", "3.0"])]
)
def test_a_value_that_may_be_static_is_named_where_no_type_differs(changes, name, values):
    assert changes[name] == [None, [[name, VALUE, *values]]]


def test_arguments_are_held_against_the_most_similar_ones_before(changes):
    first, all_fields, (change,), same = changes["similar"]
    assert first is None
    assert len(all_fields) == 2
    assert change[0] in ("state['ctrl']", "state['qpos']")
    assert same == []


def test_a_function_that_another_one_calls_while_jax_traces_it_compiles_nothing_itself(changes):
    assert changes["traced"] == [None]
