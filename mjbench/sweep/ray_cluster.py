"""The executor on Ray: each assignment is a task of it.

A task yields what the node says. It is pinned to its node and takes all of it: of the custom
resource `mjbench` where nodes declare it, of its CPUs where none does.
"""

import contextlib
import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from mjbench.errors import one_line
from mjbench.sweep import ray_session, ray_worker, software
from mjbench.sweep.executor import Died, Event, Joined, Left, LeftOut, Reported
from mjbench.sweep.messages import Finished, Message, NodeAnswer, Refused, Request
from mjbench.sweep.model_files import CarriedModel
from mjbench.sweep.ray_session import LOCAL, RESOURCE
from mjbench.sweep.scheduler import Node

# The label of a node that names its machine.
LABEL = "mjbench-machine"
# How long nodes may take to say what they are, how often the list of nodes is read, and how long
# tasks that were cancelled may take to end, in seconds.
_ANSWER_S, _NODES_S, _END_S = 120.0, 5.0, 5.0
# Ray counts resources in these.
_UNIT = 1e-4
# Ray gives its workers a low priority, and hides accelerators that a task did not ask for.
_WORKER_ENVIRONMENT = {"RAY_worker_niceness": "0", "RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO": "0"}


@dataclass(frozen=True)
class _RayNode:
    """A node as Ray lists it."""

    id: str
    address: str
    name: str
    resources: Mapping[str, float]
    labels: Mapping[str, str]

    @property
    def cpus(self) -> float:
        return self.resources.get("CPU", 0.0)


@dataclass(frozen=True)
class _Task:
    """A task of Ray: what it yields, and the node that runs it."""

    generator: Any
    node_id: str


class RayCluster:
    """A cluster of Ray, used as a context manager."""

    def __init__(self, address: str | None = None):
        """Connect to nothing yet.

        Args:
          address: of a cluster, or `auto` for the one that runs here; None to start one here.
        """
        self._address = address or LOCAL
        self._closing = contextlib.ExitStack()
        self._running: dict[int, _Task] = {}
        self._asked: dict[Any, _RayNode] = {}
        self._known: dict[str, _RayNode] = {}
        self._models: dict[str, Any] = {}
        self._nodes_read_s = -_NODES_S
        self._events: list[Event] = []
        # whether only nodes that declare the resource measure: once one has, also when it is gone
        self._must_declare = False

    def __enter__(self) -> "RayCluster":
        """Start Ray here, or connect to a cluster.

        Raises:
          InputError: the address is not one that can be used.
          MachineError: Ray is missing, does not start, or is not there.
        """
        with contextlib.ExitStack() as closing:
            closing.enter_context(ray_session.session(self._address))
            import ray

            self._measure = ray.remote(ray_worker.measure)
            self._describe = ray.remote(ray_worker.describe)
            closing.callback(self._cancel_all)
            self._closing = closing.pop_all()
        return self

    def __exit__(self, *exception: object) -> None:
        """Cancel what runs; a cluster that was started here ends."""
        self._closing.close()

    # -- nodes -----------------------------------------------------------------------------------

    def ask_nodes(self) -> list[Event]:
        """Return which nodes there are, when all have said what they are."""
        import ray

        self._read_nodes()
        if self._asked:
            ray.wait(list(self._asked), num_returns=len(self._asked), timeout=_ANSWER_S)
        for reference in list(self._asked):
            self._take_answer(reference)
        events, self._events = self._events, []
        return events

    def _read_nodes(self) -> None:
        """Ask nodes that are new, and note those that are gone."""
        import ray

        self._nodes_read_s = time.monotonic()
        listed = ray.nodes()
        alive = {node.id: node for node in map(_ray_node, listed) if node is not None}
        deaths = {node["NodeID"]: node.get("DeathReasonMessage") or "" for node in listed}
        for node_id in [known for known in self._known if known not in alive]:
            del self._known[node_id]
            reason = one_line(deaths.get(node_id, ""), 100)
            self._events.append(Left(node_id, f"it is gone{f' ({reason})' if reason else ''}"))
            # its workers may live on for a while, and Ray waits for them
            for number in [n for n, task in self._running.items() if task.node_id == node_id]:
                del self._running[number]
                self._events.append(Died(number, "its node is gone"))
        self._must_declare = self._must_declare or any(map(_declares, alive.values()))
        for node in alive.values():
            if not (_declares(node) if self._must_declare else node.cpus >= 1):
                continue
            if node.id not in self._known:
                self._known[node.id] = node
                reference = self._describe.options(num_cpus=0, **_pinned(node)).remote()
                self._asked[reference] = node

    def _take_answer(self, reference: Any) -> None:
        """Note what a node says of itself."""
        import ray

        node = self._asked.pop(reference)
        try:
            answer: NodeAnswer = ray.get(reference, timeout=0)
        except Exception as error:
            reason = _cause(error)
            if isinstance(error, ray.exceptions.GetTimeoutError):
                ray.cancel(reference, force=True)
                reason = f"it did not answer within {_ANSWER_S:.0f} s"
            self._events.append(LeftOut(node.name, reason))
            return
        difference = software.difference(software.installed(), answer.software)
        if difference:
            self._events.append(LeftOut(node.name, difference))
            return
        if node.id not in self._known:
            self._events.append(LeftOut(node.name, "it is gone"))
            return
        machine = answer.machine
        label = node.labels.get(LABEL) or machine.label
        own = Node(node.id, node.name, machine.host or node.address, label, machine.usable_cores)
        self._events.append(Joined(own, machine))

    # -- assignments -----------------------------------------------------------------------------

    def start(
        self, number: int, node: Node, request: Request, carried: Sequence[CarriedModel]
    ) -> None:
        """Have a node measure; see `Executor`."""
        ray_node = self._known.get(node.id)
        if ray_node is None:
            self._events.append(Died(number, "its node is gone"))
            return
        options = _share(ray_node, 1.0 if request.limits is not None else 1 / node.cores)
        task = self._measure.options(
            num_returns="streaming", max_retries=0, **options, **_pinned(ray_node)
        )
        generator = task.remote(request, *map(self._reference, carried))
        self._running[number] = _Task(generator, node.id)

    def _reference(self, carried: CarriedModel) -> Any:
        """Return a model in Ray's store, from which each node takes it once."""
        import ray

        if carried.digest not in self._models:
            self._models[carried.digest] = ray.put(carried)
        return self._models[carried.digest]

    def stop(self, number: int) -> None:
        """Have a node stop measuring; see `Executor`."""
        import ray

        if task := self._running.pop(number, None):
            ray.cancel(task.generator)

    def events(self, timeout_s: float) -> list[Event]:
        """Return what happened since the last call; see `Executor`."""
        import ray

        if time.monotonic() - self._nodes_read_s >= _NODES_S:
            self._read_nodes()
        waited = self._waited()
        timeout_s = 0.0 if self._events else timeout_s
        if not waited:
            time.sleep(timeout_s)
        while waited:
            ready, _ = ray.wait(waited, num_returns=1, timeout=timeout_s, fetch_local=False)
            if not ready:
                break
            self._take(ready[0])
            waited, timeout_s = self._waited(), 0.0
        events, self._events = self._events, []
        return events

    def _waited(self) -> list[Any]:
        """Return what may have something to say."""
        return [*(task.generator for task in self._running.values()), *self._asked]

    def _take(self, ready: Any) -> None:
        """Note the next message of a task, or the answer of a node."""
        if ready in self._asked:
            self._take_answer(ready)
            return
        number = next(n for n, task in self._running.items() if task.generator is ready)
        try:
            import ray

            message: Message = ray.get(next(ready))
        except StopIteration:  # its last message came before
            del self._running[number]
            self._events.append(Died(number, "it ended without a result"))
        except Exception as error:
            del self._running[number]
            self._events.append(Died(number, _cause(error)))
        else:
            if isinstance(message, Refused | Finished):
                del self._running[number]
            self._events.append(Reported(number, message))

    def _cancel_all(self) -> None:
        """Have all nodes stop; those that do not within some seconds lose their worker."""
        import ray

        running = [task.generator for task in self._running.values()]
        self._running = {}
        for is_forced in (False, True):
            if not running:
                return
            for generator in running:
                with contextlib.suppress(Exception):  # it has ended, or its node is gone
                    ray.cancel(generator, force=is_forced)
            running = _not_ended(running)


# -- Ray's own ----------------------------------------------------------------------------------


def _ray_node(listed: Mapping[str, Any]) -> _RayNode | None:
    """Return a node that is alive; None where it is not."""
    if not listed.get("Alive"):
        return None
    address = str(listed.get("NodeManagerAddress", ""))
    name = str(listed.get("NodeManagerHostname") or address)
    node_id = str(listed["NodeID"])
    return _RayNode(
        node_id,
        address,
        f"{name} ({node_id[:4]})",
        dict(listed.get("Resources", {})),
        dict(listed.get("Labels", {})),
    )


def _declares(node: _RayNode) -> bool:
    """Return whether a node declares the resource by which it may be taken."""
    return bool(node.resources.get(RESOURCE))


def _share(node: _RayNode, share: float) -> dict[str, Any]:
    """Return the resources that a task takes of a node."""
    whole = node.resources.get(RESOURCE)
    if whole is None:
        return {"num_cpus": node.cpus if share == 1 else 1}
    units = math.floor(whole * share / _UNIT + 1e-6)
    amount = whole if share == 1 else round(max(1, units) * _UNIT, 4)
    return {"num_cpus": 0, "resources": {RESOURCE: amount}}


def _pinned(node: _RayNode) -> dict[str, Any]:
    """Return what keeps a task on a node, and what its worker has in its environment."""
    from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy

    return {
        "scheduling_strategy": NodeAffinitySchedulingStrategy(node.id, soft=False),
        "runtime_env": {"env_vars": _WORKER_ENVIRONMENT},
    }


def _not_ended(generators: Sequence[Any]) -> list[Any]:
    """Return those of some cancelled tasks that do not end within some seconds."""
    import ray

    with contextlib.suppress(Exception):
        ends = {generator.completed(): generator for generator in generators}
        _, missing = ray.wait(list(ends), num_returns=len(ends), timeout=_END_S, fetch_local=False)
        return [ends[reference] for reference in missing]
    return []


def _cause(error: Exception) -> str:
    """Return why a task did not end well, in one line."""
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
