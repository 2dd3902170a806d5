"""Ray as a sweep uses it: a cluster that is started here, or joined, and commands as its tasks.

Ray places tasks, and runs them again where their node or their command fails. A task yields the
cells of its command in their order, so that a further attempt goes on after those that came before.
"""

import contextlib
import logging
import os
import socket
import time
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import psutil

from mjbench import extras
from mjbench.errors import Failure, InputError, MachineError, one_line, shown
from mjbench.host import child, files
from mjbench.host.machine import LABEL_VARIABLE, Machine
from mjbench.paths import local_ray
from mjbench.status import Status
from mjbench.sweep import node, software
from mjbench.sweep.model_files import CarriedModel
from mjbench.sweep.node import BusyError, NodeMeasurement, NotMeasuredError, Request

# The custom resource by which a node says that it may be taken, and the label with the name of its
# machine.
RESOURCE, LABEL = "mjbench", "mjbench-machine"
# How long nodes may take to say what they are, how often the list of nodes is read while nothing
# happens, and how long cancelled tasks may take to end, in seconds.
_ANSWER_S, _LOOK_S, _END_S = 120.0, 5.0, 5.0
# What a command takes of its node: a timed one all of it, others one CPU, beside no timed one.
_TIMED: Mapping[str, Any] = {"num_cpus": 0, "resources": {RESOURCE: 1}}
_UNTIMED: Mapping[str, Any] = {"num_cpus": 1, "resources": {RESOURCE: 0.001}}
# Ray gives its workers a low priority, and hides accelerators that a task did not ask for.
_WORKER_ENVIRONMENT = {"RAY_worker_niceness": "0", "RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO": "0"}
_NODE_ID, _THREADS = "ray.io/node-id", "OMP_NUM_THREADS"

# How often Ray runs a task again whose worker took too much memory; otherwise, it never stops.
_MEMORY_RETRIES = "2"
# Addresses of a cluster that is started here, and of the one that this machine belongs to.
LOCAL, AUTO = "local", "auto"
# How long the head of a cluster may take to accept a connection, in seconds.
_CONNECT_S = 10.0
# The longest folder in which Ray's sockets can be: their whole path has 107 bytes at most.
_LONGEST_FOLDER, _SHORT_FOLDER = 40, "/tmp/ray"


@dataclass(frozen=True)
class ClusterNode:
    """A node that can measure; its label is empty without one."""

    id: str
    name: str
    label: str
    machine: Machine


@dataclass(frozen=True)
class LeftOut:
    """A node that cannot measure."""

    id: str
    name: str
    reason: str


@dataclass(frozen=True)
class Failed:
    """A command has failed in its last attempt, on a machine; None if its node is gone."""

    request: Request
    failure: Failure
    machine: Machine | None = None


@dataclass(frozen=True)
class Refused:
    """A node did not become quiet, and gives a command back."""

    request: Request
    reason: str


Event = NodeMeasurement | Failed | Refused


class RayCluster:
    """A cluster of Ray, as a context manager; nodes that join later are not among its `nodes`."""

    def __init__(self, address: str | None = None, tries: int = 3):
        """Connect to nothing yet; `auto` is the cluster that runs here; None starts one."""
        self._address, self._tries = address or LOCAL, tries
        self._running: dict[Any, Request] = {}
        self._models: dict[str, Any] = {}
        self.nodes: tuple[ClusterNode, ...] = ()
        self.left_out: tuple[LeftOut, ...] = ()

    def __enter__(self) -> "RayCluster":
        with contextlib.ExitStack() as closing:
            closing.enter_context(session(self._address))
            closing.callback(self._cancel_all)
            import ray

            self._measure = ray.remote(_measure)
            answers = _ask(_listed())
            self.nodes = tuple(one for one in answers if isinstance(one, ClusterNode))
            self.left_out = tuple(one for one in answers if isinstance(one, LeftOut))
            self._closing = closing.pop_all()
        return self

    def __exit__(self, *exception: object) -> None:
        self._closing.close()

    def submit(self, request: Request, carried: Sequence[CarriedModel] = ()) -> None:
        """Have a node measure, as soon as one is free."""
        selector = {LABEL: request.cells[0].machine} if request.cells[0].machine else {}
        if self.left_out:
            selector[_NODE_ID] = f"!in({','.join(one.id for one in self.left_out)})"
        task = self._measure.options(
            num_returns="streaming",
            max_retries=self._tries - 1,
            retry_exceptions=[NotMeasuredError],
            scheduling_strategy="SPREAD",
            label_selector=selector,
            runtime_env={"env_vars": _WORKER_ENVIRONMENT},
            **(_UNTIMED if request.rules is None else _TIMED),
        )
        self._running[task.remote(request, *map(self._reference, carried))] = request

    def events(self, patience_s: float) -> Iterator[Event]:
        """Yield what happens until nothing runs, or for too long no node can measure the rest."""
        import ray

        possible_s = time.monotonic()
        while self._running:
            ready, _ = ray.wait(list(self._running), timeout=_LOOK_S, fetch_local=False)
            if ready:
                yield from self._take(ready[0])
            if ready or self._is_possible():
                possible_s = time.monotonic()
            elif time.monotonic() - possible_s >= patience_s:
                return

    def _take(self, task: Any) -> Iterator[Event]:
        """Yield what a task has to say next; nothing where it has ended well."""
        import ray

        try:
            yield ray.get(next(task))
        except StopIteration:
            del self._running[task]
        except Exception as error:  # which ones Ray raises is not documented
            yield _ended(self._running.pop(task), error)

    def _is_possible(self) -> bool:
        left_out = {one.id for one in self.left_out}
        labels = {_label(one) for one in _listed() if one["NodeID"] not in left_out}
        wanted = {request.cells[0].machine for request in self._running.values()}
        return bool(labels & wanted or (labels and "" in wanted))

    def _reference(self, carried: CarriedModel) -> Any:
        import ray

        if carried.digest not in self._models:
            self._models[carried.digest] = ray.put(carried)
        return self._models[carried.digest]

    def _cancel_all(self) -> None:
        import ray

        with contextlib.suppress(Exception):  # the cluster is gone
            for task in self._running:
                ray.cancel(task)
            ends = [task.completed() for task in self._running]
            if ends:
                ray.wait(ends, num_returns=len(ends), timeout=_END_S, fetch_local=False)


# -- on nodes -----------------------------------------------------------------------------------


def _measure(request: Request, *carried: CarriedModel) -> Iterator[NodeMeasurement]:
    """Measure on this node, without what Ray does to its workers."""
    import ray

    parent = os.getppid()  # the node's own process, which a worker outlives while it is busy
    child.die_with_parent(parent)
    # Ray sets it for its workers; the command is to have what the starter of Ray has set
    with contextlib.suppress(psutil.Error):
        if _THREADS not in psutil.Process(parent).environ():
            os.environ.pop(_THREADS, None)
    context = ray.get_runtime_context()
    label = context.get_node_labels().get(LABEL, "")
    name = _name(socket.gethostname(), context.get_node_id())
    try:
        yield from node.measure(request, *carried, name=name, label=label)
    except BusyError as error:
        raise BusyError(f"{name}: {error}") from None


# -- Ray's own ----------------------------------------------------------------------------------


def _listed() -> list[Mapping[str, Any]]:
    """Return the nodes that are alive and declare that they may be taken."""
    import ray

    return [
        one
        for one in ray.nodes()
        if one.get("Alive")
        and all(one["Resources"].get(name, 0) >= 1 for name in (RESOURCE, "CPU"))
    ]


def _label(listed: Mapping[str, Any]) -> str:
    return str(listed.get("Labels", {}).get(LABEL, ""))


def _name(host: str, node_id: str) -> str:
    return f"{host} ({node_id[:4]})"


def _ask(listed: Sequence[Mapping[str, Any]]) -> list[ClusterNode | LeftOut]:
    import ray
    from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy

    answers: list[Any] = [
        ray.remote(node.describe)
        .options(
            num_cpus=0,
            scheduling_strategy=NodeAffinitySchedulingStrategy(one["NodeID"], soft=False),
            runtime_env={"env_vars": _WORKER_ENVIRONMENT},
        )
        .remote()
        for one in listed
    ]
    if answers:
        ray.wait(answers, num_returns=len(answers), timeout=_ANSWER_S)
    return [_answer(one, answer) for one, answer in zip(listed, answers, strict=True)]


def _answer(listed: Mapping[str, Any], answer: Any) -> ClusterNode | LeftOut:
    import ray

    node_id = str(listed["NodeID"])
    name = _name(str(listed.get("NodeManagerHostname", "")), node_id)
    try:
        there, machine = ray.get(answer, timeout=0)
    except ray.exceptions.GetTimeoutError:
        ray.cancel(answer, force=True)
        return LeftOut(node_id, name, f"it did not answer within {_ANSWER_S:.0f} s")
    except Exception as error:
        return LeftOut(node_id, name, _cause(error))
    if difference := software.difference(software.installed(), there):
        return LeftOut(node_id, name, difference)
    return ClusterNode(node_id, name, _label(listed), machine)


def _ended(request: Request, error: Exception) -> Failed | Refused:
    match getattr(error, "cause", None):
        case BusyError() as busy:
            return Refused(request, str(busy))
        case NotMeasuredError(failure=failure, machine=machine):
            return Failed(request, failure, machine)
    return Failed(request, Failure(Status.CRASHED, _cause(error)))


def _cause(error: Exception) -> str:
    import ray

    match error:
        case ray.exceptions.RayTaskError():
            cause = error.cause if isinstance(error.cause, Exception) else error
            return one_line(f"{type(cause).__name__}: {cause}")
        case ray.exceptions.WorkerCrashedError() | ray.exceptions.OutOfMemoryError():
            return "its worker was killed"
        case ray.exceptions.TaskUnschedulableError() | ray.exceptions.NodeDiedError():
            return "its node is gone"
    return one_line(f"{type(error).__name__}: {error}", 160)


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
    folder = closing.enter_context(files.temporary_folder())
    is_short = len(str(folder)) <= _LONGEST_FOLDER
    with local_ray.secret_environment():
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
