"""Loops that JAX compiles, with little to do in each iteration."""

import jax
from jax import lax
from jax import numpy as jnp

jax.config.update("jax_enable_x64", True)

COUNT = 2_000
LAST = jnp.int32(20_000)
# Of a filter: the variance of each measurement, what it is of, and how the state moves on.
VARIANCES = jnp.linspace(0.5, 1.0, COUNT)
ROWS = jnp.linspace(0.0, 1.0, COUNT * 3).reshape(COUNT, 3)
TRANSITION = jnp.array([[0.9, 0.1, 0.0], [0.0, 0.9, 0.1], [0.0, 0.0, 0.9]])
TRANSITIONS = jnp.broadcast_to(TRANSITION, (COUNT, 3, 3))


@jax.jit
def _filter(
    variances: jax.Array, rows: jax.Array, transitions: jax.Array
) -> tuple[jax.Array, jax.Array]:
    def update(
        covariance: jax.Array, measurement: tuple[jax.Array, jax.Array, jax.Array]
    ) -> tuple[jax.Array, tuple[jax.Array, jax.Array]]:
        variance, row, transition = measurement
        total = variance + row @ covariance @ row
        gain = covariance @ row / total
        left = covariance - total * jnp.outer(gain, gain)
        return transition @ left @ transition.T + 0.1 * jnp.eye(3), (total, gain)

    return lax.scan(update, jnp.eye(3), (variances, rows, transitions))[1]


@jax.jit
def _count(last: jax.Array) -> jax.Array:
    return lax.while_loop(
        lambda carry: carry[0] < last,
        lambda carry: (jnp.maximum(carry[0], carry[1]), carry[1] + 1),
        (jnp.int32(0), jnp.int32(0)),
    )[1]


def covariances() -> tuple[jax.Array, jax.Array]:
    """Filter measurements, in a scan that carries a matrix of 3 x 3."""
    return _filter(VARIANCES, ROWS, TRANSITIONS)


def count() -> jax.Array:
    """Count, in a loop that carries two numbers."""
    return _count(LAST)
