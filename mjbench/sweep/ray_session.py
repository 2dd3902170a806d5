"""Ray as a sweep uses it: started on this machine, or connected to, and ended afterwards."""

import contextlib
import logging
import os
import socket
import warnings
from collections.abc import Iterator
from typing import Any

from mjbench import extras
from mjbench.errors import InputError, MachineError, one_line, shown
from mjbench.host import ray_environment, scratch
from mjbench.host.machine import LABEL_VARIABLE
from mjbench.paths import local_ray

# The custom resource by which a node says that it may be taken, and the label with the name of its
# machine.
RESOURCE, LABEL = "mjbench", "mjbench-machine"
# How often Ray runs a task again whose worker took too much memory; otherwise, it never stops.
_MEMORY_RETRIES = "2"
# Addresses of a cluster that is started here, and of the one that this machine belongs to.
LOCAL, AUTO = "local", "auto"
# How long the head of a cluster may take to accept a connection, in seconds.
_CONNECT_S = 10.0
# The longest folder in which Ray's sockets can be: their whole path has 107 bytes at most.
_LONGEST_FOLDER, _SHORT_FOLDER = 40, "/tmp/ray"


@contextlib.contextmanager
def session(address: str) -> Iterator[None]:
    """Start Ray here, or connect to a cluster, for as long as the block runs."""
    extras.require("mjbench sweep", "ray", ["ray"])
    if "://" in address:
        raise InputError(
            f"--address {shown(address)}: run mjbench on a machine of the cluster, and"
            f" give --address {AUTO}"
        )
    _check_reachable(address)
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    os.environ.setdefault("RAY_task_oom_retries", _MEMORY_RETRIES)
    with contextlib.ExitStack() as closing:
        # Ray's warnings are about its own next releases
        closing.enter_context(warnings.catch_warnings(action="ignore"))
        with local_ray.own_signals():
            _connect(address, closing)
        closing.enter_context(_unheard())
        yield


def _connect(address: str, closing: contextlib.ExitStack) -> None:
    if address != LOCAL:
        _start(address, closing)
        return
    folder = closing.enter_context(scratch.folder())
    is_short = len(str(folder)) <= _LONGEST_FOLDER
    with ray_environment.local():
        _start(
            LOCAL,
            closing,
            include_dashboard=False,
            resources={RESOURCE: 1},
            labels={LABEL: label} if (label := os.environ.get(LABEL_VARIABLE, "")) else None,
            _temp_dir=str(folder) if is_short else _SHORT_FOLDER,
        )


def _start(address: str, closing: contextlib.ExitStack, **arguments: Any) -> None:
    import ray

    closing.callback(ray.shutdown)
    try:
        ray.init(address, log_to_driver=False, logging_level=logging.ERROR, **arguments)
    except Exception as error:  # which ones Ray raises is not documented
        if address == LOCAL:
            raise MachineError(f"Ray does not start here: {one_line(error)}") from error
        raise _no_cluster(address, one_line(error).rstrip(".")) from error


def _no_cluster(address: str, reason: str) -> MachineError:
    return MachineError(
        f"no cluster of Ray at {shown(address)}: {reason}; start one by `ray start --head`, or"
        " leave out --address"
    )


def _check_reachable(address: str) -> None:
    """Refuse an address where nothing listens: Ray would try for minutes."""
    if address == AUTO:
        address = os.environ.get("RAY_ADDRESS", AUTO)
    host, colon, port = address.rpartition(":")
    if not (colon and port.isdecimal()):
        return  # which Ray resolves, or refuses
    try:
        socket.create_connection((host.strip("[]"), int(port)), timeout=_CONNECT_S).close()
    except (OSError, OverflowError, UnicodeError) as error:
        reason = getattr(error, "strerror", None) or one_line(error)
        raise _no_cluster(address, reason) from error


@contextlib.contextmanager
def _unheard() -> Iterator[None]:
    """Keep Ray's log lines about nodes and workers from standard output, where it prints them."""
    import ray

    module = ray._private.worker
    show = getattr(module, "print_to_stdstream", None)
    if show is None:  # another version of Ray
        yield
        return
    module.print_to_stdstream = lambda *arguments, **options: None
    try:
        yield
    finally:
        module.print_to_stdstream = show
