"""Facts of models, gathered in a child process so that a crash costs one row."""

from dataclasses import asdict
from pathlib import Path
from typing import Any

from mjbench.errors import InputError
from mjbench.instrument import isolate
from mjbench.instrument.isolate import Channel
from mjbench.simulation import models


def facts(sources: list[models.ModelSource], limit_s: float) -> list[dict[str, Any]]:
    """Return the facts of each model: model, status, detail, and those of `work.describe`."""
    rows: list[dict[str, Any]] = []
    while len(rows) < len(sources):
        left = [{"name": s.name, "path": str(s.path)} for s in sources[len(rows) :]]
        ended = isolate.run(
            "mjbench.comparison.listing:describe_all", {"models": left}, rows.append, limit_s
        )
        if len(rows) < len(sources):  # the child ended while describing the next one
            name = sources[len(rows)].name
            rows.append({"model": name, "status": ended.status, "detail": ended.detail})
    return rows


def describe_all(request: dict[str, Any], channel: Channel) -> None:
    """Send the facts of each model in `request`; runs in the child."""
    from mjbench.simulation import work

    for entry in request["models"]:
        name = entry["name"]
        channel.where(f"loading {name}")
        try:
            described = work.describe(models.load(models.ModelSource(name, Path(entry["path"]))))
            channel.send(model=name, status="ok", detail="", **asdict(described))
        except InputError as error:
            channel.send(model=name, status="input", detail=str(error))
