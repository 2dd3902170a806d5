"""Facts of models, gathered in a child process so that a crash costs one row."""

from collections.abc import Sequence
from dataclasses import dataclass

from mjbench.errors import InputError
from mjbench.host import isolate
from mjbench.host.isolate import Channel
from mjbench.simulation import models, reference_run
from mjbench.simulation.models import ModelSource
from mjbench.simulation.reference_run import ModelFacts
from mjbench.status import Status


@dataclass(frozen=True)
class ListedModel:
    """A model and its facts."""

    model: str
    status: Status
    detail: str = ""
    facts: ModelFacts | None = None


def list_models(sources: Sequence[ModelSource], limit_s: float) -> list[ListedModel]:
    rows: list[ListedModel] = []
    while len(rows) < len(sources):
        remaining = [ModelSource(s.name, s.path.resolve()) for s in sources[len(rows) :]]
        ended = isolate.run(describe_all, (remaining,), rows.append, limit_s)
        if len(rows) < len(sources):  # the child ended while describing the next one
            rows.append(ListedModel(sources[len(rows)].name, ended.status, ended.detail))
    return rows


def describe_all(sources: Sequence[ModelSource], channel: Channel) -> None:
    for source in sources:
        channel.doing(f"loading {source.name}")
        try:
            facts = reference_run.describe(models.load(source))
            channel.send(ListedModel(source.name, Status.OK, facts=facts))
        except InputError as error:
            channel.send(ListedModel(source.name, Status.INPUT, str(error)))
