"""The environment in which Ray is imported and started on this machine, for this process alone.

Ray's processes listen on ports. They know each other by a secret; without it, anybody who reaches
these ports can run programs here.
"""

import contextlib
import os
import secrets
import sys
from collections.abc import Iterator, Mapping

# Ray reads it when it is imported, so it is empty where others did that.
_secret: dict[str, str] = {}


@contextlib.contextmanager
def local(further: Mapping[str, str | None] | None = None) -> Iterator[None]:
    """Set the secret of this process for the block in which Ray is imported, or started here."""
    if "ray" not in sys.modules:
        _secret.update(RAY_AUTH_MODE="token", RAY_AUTH_TOKEN=secrets.token_hex(32))
    values = {**(further or {}), **_secret}
    before = {name: os.environ.get(name) for name in values}
    _set(values)
    try:
        yield
    finally:
        _set(before)


def _set(values: Mapping[str, str | None]) -> None:
    for name, value in values.items():
        if value is None:
            os.environ.pop(name, None)
        else:
            os.environ[name] = value
