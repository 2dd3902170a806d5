"""Ray on this machine alone, for as long as somebody in this process uses it.

The first `acquire` starts it, the last `release` ends it with all its processes. It has no
dashboard, prints nothing, sends no usage statistics, answers only those who know its secret, and
writes to a temporary folder that goes with it. An address in RAY_ADDRESS is ignored: what is
compared is this machine. Where this process ends without a release, however that happens, a guard
ends what is left of its session.
"""

import contextlib
import logging
import os
import secrets
import signal
import sys
import threading
from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path

from mjbench.errors import MachineError, describe
from mjbench.host import files, session_guard

# Ray's own minimum for the object store is 75 MiB.
_LEAST_STORE_BYTES = 128 << 20
# The longest name that a socket can have, in bytes, and what Ray adds to its temporary folder:
# `/session_2026-11-23_14-55-56_123456_1234567/sockets/plasma_store.1`.
_SOCKET_NAME_BYTES, _RAY_ADDS_BYTES = 107, 68
_SIGNALS = ("SIGINT", "SIGTERM", "SIGHUP")
# The environment in which Ray's processes start. One thread is all that an actor has.
_ENVIRONMENT: Mapping[str, str | None] = {
    "RAY_USAGE_STATS_ENABLED": "0",
    "RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO": "0",  # otherwise Ray prints a FutureWarning
    "RAY_ADDRESS": None,
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
}

# Ray's processes listen on ports. They know each other by a secret; without it, anybody who reaches
# these ports can run programs here. Ray reads it when it is imported, so it is empty where others
# did that.
_secret: dict[str, str] = {}


@dataclass
class _LocalRay:
    users: int = 0
    closing: ExitStack = field(default_factory=ExitStack)


_local = _LocalRay()


def acquire(store_bytes: int) -> None:
    """Use Ray until `release`, and start it where nobody in this process uses it yet.

    A new object store gets room for `store_bytes` at a time. MachineError where Ray does not start.
    """
    with secret_environment():
        import ray

    if _local.users == 0 and not ray.is_initialized():
        _start(max(_LEAST_STORE_BYTES, store_bytes))
    _local.users += 1


def release() -> None:
    """End the use that `acquire` began, and Ray with the last one."""
    _local.users -= 1
    if _local.users == 0:
        _local.closing.close()


def _start(store_bytes: int) -> None:
    import ray

    with ExitStack() as closing:
        folder = closing.enter_context(files.temporary_folder())
        if len(os.fsencode(folder)) + _RAY_ADDS_BYTES > _SOCKET_NAME_BYTES:
            raise MachineError(
                f"Ray needs a temporary folder with a shorter name than {folder}: set TMPDIR"
            )
        closing.callback(session_guard.start())
        closing.callback(ray.shutdown)
        # actors import what this process does
        path = os.pathsep.join(folder or str(Path.cwd()) for folder in sys.path)
        environment = {**_ENVIRONMENT, "PYTHONPATH": path}
        with secret_environment(environment), own_signals():
            try:
                ray.init(
                    address="local",
                    num_cpus=0,  # an actor needs none; otherwise Ray starts a process for each
                    num_gpus=0,
                    object_store_memory=store_bytes,
                    include_dashboard=False,
                    log_to_driver=False,
                    logging_level=logging.CRITICAL,
                    _temp_dir=str(folder),
                )
            except Exception as error:  # Ray raises what its services and the system do
                raise MachineError(f"Ray does not start: {describe(error)}") from error
        _local.closing = closing.pop_all()


@contextlib.contextmanager
def own_signals() -> Iterator[None]:
    """Put back the handlers of signals that Ray replaces."""
    numbers = [getattr(signal, name) for name in _SIGNALS if hasattr(signal, name)]
    handlers = {number: signal.getsignal(number) for number in numbers}
    try:
        yield
    finally:
        is_main = threading.current_thread() is threading.main_thread()
        for number, handler in handlers.items():
            if is_main and handler is not None and signal.getsignal(number) != handler:
                signal.signal(number, handler)


@contextlib.contextmanager
def secret_environment(further: Mapping[str, str | None] | None = None) -> Iterator[None]:
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
