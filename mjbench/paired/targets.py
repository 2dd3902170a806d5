"""Targets: what a paired comparison compares, and how a user writes one.

A target is written as settings, such as `path=rollout,threads=2` (see `parse`).
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from mjbench import paths
from mjbench.errors import InputError, describe
from mjbench.formats import listed
from mjbench.paired.metrics import METRICS, Metric
from mjbench.paired.records import TargetRow
from mjbench.paths import base
from mjbench.releases import release_names
from mjbench.simulation import model_options, models

_TIMER = ("on", "off")
_DEFAULTS = {"path": paths.BASE, "release": release_names.INSTALLED}
_SHARED = ("model", *_DEFAULTS)


@dataclass(frozen=True)
class Target:
    """One of the two things that a paired comparison compares.

    Attributes:
      has_timer: whether steps read the timer of MuJoCo's Python package.
      prepare_run: task that prepares a run; None for `Worker.prepare_run`.
    """

    release: release_names.ReleaseSpec
    model: models.ModelSource
    path: str = paths.BASE
    options: Mapping[str, Any] = field(default_factory=dict)
    model_options: Mapping[str, str] = field(default_factory=dict)
    has_timer: bool = True
    prepare_run: Callable[..., int] | None = None

    @property
    def nthread(self) -> int:
        return base.nthread(self.options)

    @property
    def files(self) -> list[Path]:
        """The files that it is made of: its model, and the wheels of its release."""
        return [self.model.path, *self.release.files]

    def row(self) -> TargetRow:
        return TargetRow(
            release=self.release.version,
            model=self.model.name,
            path=self.path,
            options=dict(self.options),
            model_options=dict(self.model_options),
            build=self.release.key,
            has_timer=self.has_timer,
            packages=self.release.name if self.release.has_packages else "",
        )


def parse(baseline: str, candidate: str) -> tuple[Target, Target]:
    """Return the targets that two texts such as `robot.xml,path=rollout,threads=2` describe.

    A model, path or release that one text leaves out is the other's.
    """
    first, second = _settings(baseline), _settings(candidate)
    shared = {key: each[key] for each in (second, first) for key in _SHARED if key in each}
    models.check_any([shared["model"]] if "model" in shared else [])
    both = {**_DEFAULTS, **shared}
    return _target(baseline, {**both, **first}), _target(candidate, {**both, **second})


def of_releases(
    specs: Sequence[release_names.ReleaseSpec],
    sources: Sequence[models.ModelSource],
    path_names: Sequence[str],
) -> list[tuple[Target, Target]]:
    """Return the pairs of the first release and each other: every model, stepped by every path."""
    baseline, *candidates = specs
    options = {name: complete_options(find_path(name), {}) for name in path_names}
    return [
        (
            Target(baseline, source, name, options[name]),
            Target(release, source, name, options[name]),
        )
        for release in candidates
        for source in sources
        for name in path_names
    ]


def check_metric(metric: Metric, path_names: Iterable[str]) -> None:
    refusal = METRICS[metric].refusal
    if METRICS[metric].compiles:
        raise InputError(f"--metric {metric} {refusal}: `mjbench versions … --paths mjx`")
    others = dict.fromkeys(name for name in path_names if refusal and name != paths.BASE)
    if others:
        raise InputError(f"--metric {metric} {refusal}: leave out {listed([*others])}")


def check_targets(metric: Metric, targets: Sequence[Target]) -> None:
    """Refuse targets that cannot be compared by a metric, or that it does not tell apart."""
    check_metric(metric, [target.path for target in targets])
    spec = METRICS[metric]
    for target in targets:
        unused = [*target.options] if spec.refusal else []
        if not (target.has_timer or spec.is_of_steps):
            unused.append("timer")
        if spec.reads_source or spec.is_exact:
            unused += target.model_options
        if unused:
            raise InputError(
                f"--metric {metric} compares {spec.meaning} without {listed(unused)}: leave out"
                f" {listed(unused)}"
            )


def find_path(name: str) -> paths.SteppingPath:
    path = paths.find(name)
    if path.compiles:
        raise InputError(
            f"path {name} compiles first and rounds differently from C, so the two cannot alternate"
            f" in blocks of the same work; compare them with `mjbench compare --paths {name}`,"
            f" or two releases of it with `mjbench versions --paths {name}`"
        )
    return path


def complete_options(path: paths.SteppingPath, options: Mapping[str, Any]) -> dict[str, Any]:
    try:
        return path.complete(options)
    except Exception as error:
        raise InputError(f"path {path.name}: {describe(error)}") from error


def _settings(text: str) -> dict[str, str]:
    settings = {}
    parts = [text] if models.is_file(Path(text)) else text.split(",")
    for setting in filter(None, parts):
        key, value = _split(setting)
        if release_names.is_release(setting):
            raise InputError(
                f"{text!r}: a release is release={setting}; `mjbench versions` compares releases"
            )
        if "=" not in setting or models.is_file(Path(setting)):
            _check_model(setting)
            key, value = "model", setting
        if key == "option":  # option=solver:cg is the same as solver=cg
            key, value = _split(value.replace(":", "="))
        if not key or not value:
            raise InputError(f"{text!r}: {setting!r} is not KEY=VALUE, such as path=rollout")
        if key in settings:
            raise InputError(f"{text!r}: {key} is given twice")
        settings[key] = value
    return settings


def _check_model(name: str) -> None:
    """Refuse a part of a side that has no `=` and names no model."""
    try:
        models.resolve(name)
    except InputError as error:
        if Path(name).suffix in models.SUFFIXES:
            raise
        raise InputError(
            f"{error}; a setting is KEY=VALUE, such as path=rollout, and two revisions need a"
            " function after them, such as bench.py::step"
        ) from None


def _split(setting: str) -> tuple[str, str]:
    key, _, value = setting.partition("=")
    return key.strip(), value.strip()


def _target(text: str, settings: Mapping[str, str]) -> Target:
    """Return the target of complete settings; `text` is what the user wrote."""
    path = find_path(settings["path"])
    path_options = {option.name: option for option in path.options}
    options: dict[str, Any] = {}
    fields: dict[str, str] = {}
    try:
        if settings.get("timer", "on") not in _TIMER:
            raise InputError("timer is on or off")
        for key, value in settings.items():
            if key in _SHARED or key == "timer":
                continue
            if key in path_options:
                options[key] = path_options[key].value(value)
            elif key in model_options.FIELDS:
                model_options.check(key, value)
                fields[key] = value
            else:
                raise InputError(
                    f"no {key!r}; path {path.name} has {', '.join(path_options) or 'no options'};"
                    f" other keys are {', '.join(_SHARED)}, timer, and the fields of MjOption"
                    f" {', '.join(model_options.FIELDS)}"
                )
    except InputError as error:
        raise InputError(f"{text!r}: {error}") from None
    return Target(
        release_names.parse_release(settings["release"]),
        models.resolve(settings["model"]),
        path.name,
        complete_options(path, options),
        fields,
        has_timer=settings.get("timer") != "off",
    )
