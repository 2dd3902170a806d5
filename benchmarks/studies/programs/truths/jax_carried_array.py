"""A loop compiled by JAX that sets one element of an array in each iteration."""

import jax
from jax import lax
from jax import numpy as jnp

SIZE = 10_000
START = jnp.arange(SIZE, dtype=jnp.float32)


def _fill(values: jax.Array, is_random: bool) -> jax.Array:
    """Set each element to an earlier one: a random one, or one that follows from the index."""

    def set_one(carry: tuple[jax.Array, jax.Array]) -> tuple[jax.Array, jax.Array]:
        index, filled = carry
        if is_random:
            chosen = jax.random.randint(jax.random.key(index), (), 0, 2)
        else:
            chosen = index**2 % SIZE
        return index + 1, filled.at[index].set(filled[chosen])

    return lax.while_loop(lambda carry: carry[0] < SIZE, set_one, (jnp.int32(0), values))[1]


fill = jax.jit(_fill, static_argnums=1)


def random_elements() -> jax.Array:
    """Copy random elements."""
    return fill(START, True)


def computed_elements() -> jax.Array:
    """Copy elements whose place is computed."""
    return fill(START, False)
