"""What a sweep is to measure, from a plan file in TOML; all of it is checked before anything runs.

docs/guides/machines.md shows a plan with all its keys.
"""

import itertools
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from mjbench.comparison import selection
from mjbench.errors import InputError, MachineError, shown, suggestion
from mjbench.limits import MAX_SECONDS
from mjbench.paired import targets
from mjbench.paired.metrics import METRICS, Metric
from mjbench.paths import BASE
from mjbench.releases import bundle, install_check, installs, package_index, release_names
from mjbench.releases.release import OLDEST, version_key
from mjbench.releases.release_names import INSTALLED, NEWEST, PREVIOUS, ReleaseSpec
from mjbench.simulation import models
from mjbench.simulation.models import ModelSource
from mjbench.sweep.busy_node import Limits, NodeRules
from mjbench.sweep.cells import CellKind
from mjbench.sweep.commands import COMMANDS, SWITCHES
from mjbench.sweep.plan_file import PlanFile

# Parses a command line of mjbench without running it; raises InputError where it is wrong.
CheckCommand = Callable[[Sequence[str]], None]
# Keys of a plan, before the first table and in each.
_TOP = ("models", "releases", "paths", "metrics", "machines")
_NODES = ("tries", "patience", "min-cores", "max-busy", "max-stolen")
# Kinds that measure releases, and how many they need.
_RELEASES_NEEDED = {CellKind.VERSIONS: 2, CellKind.INSTRUCTIONS: 1, CellKind.HISTORY: 1}
_MOST_TRIES = 100
# The key that says which release others are compared with, and its values for the first of the plan
# and for the one before.
_AGAINST, _FIRST, _BEFORE = "against", "first", "previous"


@dataclass(frozen=True)
class Plan:
    """A plan, complete and checked.

    Attributes:
      pairs: baseline and candidate of each comparison of releases.
      metrics: that they are compared by; of paths other than the plain loop, only the time.
      machines: labels of machines, each of which measures all cells; empty for one on any machine.
    """

    models: tuple[ModelSource, ...]
    releases: tuple[ReleaseSpec, ...]
    pairs: tuple[tuple[ReleaseSpec, ReleaseSpec], ...]
    paths: tuple[str, ...]
    metrics: tuple[Metric, ...]
    machines: tuple[str, ...]
    options: Mapping[CellKind, tuple[str, ...]]
    rules: NodeRules


def known_versions() -> frozenset[str]:
    """Return the releases of MuJoCo that there are, as far as it is known here; else none.

    The package index is asked where the history that comes with mjbench is missing.
    """
    try:
        history = bundle.default_path()
        known = bundle.read(history) if history.exists() else package_index.releases()
    except MachineError:
        return frozenset()
    return frozenset(release.version for release in known)


def load(
    path: Path, check: CheckCommand, known: Callable[[], Collection[str]] = known_versions
) -> Plan:
    file = PlanFile(path)
    file.check_keys(_known_keys())
    kinds = [kind for kind in CellKind if kind in file.values] or [CellKind.VERSIONS]
    releases = _releases(file, known)
    for kind in kinds:
        needed = _RELEASES_NEEDED.get(kind, 0)
        if len(releases) < needed:
            raise file.error(
                f"[{kind}] needs {needed} or more, such as"
                f" releases = {['3.3.0', '4.0.0'][:needed]}".replace("'", '"'),
                "",
                "releases",
            )
    paths, metrics = _paths(file), _metrics(file)
    if BASE not in paths and any(METRICS[metric].refusal for metric in metrics):
        raise file.error(f"all metrics but time are of {BASE} only: add it", "", "paths")
    return Plan(
        models=_models(file),
        releases=releases,
        pairs=_pairs(file, releases) if CellKind.VERSIONS in kinds else (),
        paths=paths,
        metrics=metrics,
        machines=_machines(file),
        options={kind: _options(file, kind, check) for kind in kinds},
        rules=_rules(file),
    )


def _known_keys() -> Mapping[str, Sequence[str]]:
    tables = {kind.value: COMMANDS[kind].options for kind in CellKind}
    tables[CellKind.VERSIONS] = (_AGAINST, *tables[CellKind.VERSIONS])
    return {"": _TOP, **tables, "nodes": _NODES}


# -- lists ---------------------------------------------------------------------------------------


def _models(file: PlanFile) -> tuple[ModelSource, ...]:
    sources: dict[Path, ModelSource] = {}
    for name in file.texts("models", models.shipped()):
        with file.at("", "models", name):
            if not name.isprintable():
                raise InputError(
                    f"{shown(name)}: a name that cannot be printed; give the file another one"
                )
            beside = file.path.parent / Path(name)
            try:
                is_beside = name not in models.shipped() and beside.exists()
                source = models.resolve(str(beside) if is_beside else name)
            except (OSError, ValueError) as error:  # a name that no file can have
                raise InputError(str(error)) from None
            if earlier := sources.get(source.path):
                raise InputError(f"{shown(name)} is the same file as {shown(earlier.name)}")
        sources[source.path] = replace(source, name=name)
    return tuple(sources.values())


def _paths(file: PlanFile) -> tuple[str, ...]:
    names = file.texts("paths", [BASE])
    for name in names:
        with file.at("", "paths", name):
            _refuse_own([name], "; give paths of mjbench")
            targets.find_path(name)
    return tuple(names)


def _refuse_own(names: Sequence[str], advice: str = "") -> None:
    for name in names:
        if ":" in name:
            raise InputError(f"{shown(name)}: a path of your own is not on other machines{advice}")


def _metrics(file: PlanFile) -> tuple[Metric, ...]:
    names = file.texts("metrics", [Metric.TIME])
    for name in names:
        if name not in list(Metric):
            text = f"no metric {shown(name)}{suggestion(name, Metric)}; there are"
            raise file.error(f"{text} {', '.join(Metric)}", "", "metrics", name)
    return tuple(Metric(name) for name in names)


def _machines(file: PlanFile) -> tuple[str, ...]:
    labels = file.texts("machines")
    for label in labels:
        if not label.strip() or not label.isprintable():
            raise file.error(f"{shown(label)} is not a label", "", "machines", label)
    return tuple(labels)


# -- releases -----------------------------------------------------------------------------------


def _releases(file: PlanFile, known: Callable[[], Collection[str]]) -> tuple[ReleaseSpec, ...]:
    specs: dict[str, ReleaseSpec] = {}
    versions: Collection[str] | None = None
    for name in file.texts("releases"):
        with file.at("", "releases", name):
            if name not in (INSTALLED, NEWEST, PREVIOUS) and versions is None:
                versions = known()
            for spec in _range(name, versions or ()) if ".." in name else [_release(name)]:
                _check_exists(spec, versions or ())
                if spec.version in specs:
                    raise InputError(f"{shown(name)}: MuJoCo {spec.version} is given twice")
                specs[spec.version] = spec
    return tuple(specs.values())


def _release(name: str) -> ReleaseSpec:
    spec = release_names.parse_release(name)
    if spec.wheels or spec.has_packages:
        raise InputError(f"{shown(name)}: nodes install releases from the package index; give one")
    if spec.name == INSTALLED:
        return spec
    return ReleaseSpec(spec.version, spec.version)


def _range(text: str, versions: Collection[str]) -> list[ReleaseSpec]:
    """Return the releases that `A..B` stands for, both included; either may be left out."""
    first, _, last = text.partition("..")
    low = version_key(_release(first).version) if first else OLDEST
    high = version_key(_release(last).version) if last else None
    if not versions:
        raise InputError(f"{shown(text)}: which releases there are is not known here; name each")
    within = [
        version
        for version in sorted(versions, key=version_key)
        if low <= version_key(version) and (high is None or version_key(version) <= high)
    ]
    if not within:
        raise InputError(f"{shown(text)}: there is no release between them")
    return [ReleaseSpec(version, version) for version in within]


def _check_exists(spec: ReleaseSpec, versions: Collection[str]) -> None:
    apart = {name.partition("-")[0] for name in installs.install_names()}
    here = {install_check.installed_version(), *apart}
    if versions and spec.version not in versions and spec.version not in here:
        hint = suggestion(spec.version, versions)
        raise InputError(f"there is no MuJoCo {shown(spec.version)}{hint}")


def _pairs(
    file: PlanFile, specs: Sequence[ReleaseSpec]
) -> tuple[tuple[ReleaseSpec, ReleaseSpec], ...]:
    against = file.get(CellKind.VERSIONS, _AGAINST, _FIRST)
    if against == _BEFORE:
        return tuple(itertools.pairwise(specs))
    named = {name: spec for spec in specs for name in (spec.name, spec.version)}
    named[_FIRST] = specs[0]
    if not isinstance(against, str) or against not in named:
        hint = suggestion(str(against), [_FIRST, _BEFORE, *named])
        text = f'give "{_FIRST}", "{_BEFORE}" or one of the releases{hint}'
        raise file.error(text, CellKind.VERSIONS, _AGAINST)
    baseline = named[against]
    return tuple((baseline, spec) for spec in specs if spec is not baseline)


# -- tables --------------------------------------------------------------------------------------


def _options(file: PlanFile, kind: CellKind, check: CheckCommand) -> tuple[str, ...]:
    command = COMMANDS[kind]
    options: list[str] = []
    for name in command.options:
        value = file.get(kind, name)
        if value is None:
            continue
        with file.at(kind, name):
            own = _arguments(name, value, name in SWITCHES)
            check([*command.name, *own])
            if kind == CellKind.COMPARE and name == "paths":
                _refuse_own(own[1].split(","))
                selection.variants(own[1].split(","))
        options += own
    with file.at(kind):  # values that do not fit together
        check([*command.name, *options])
    return tuple(options)


def _arguments(name: str, value: Any, is_switch: bool) -> list[str]:
    if isinstance(value, bool) or is_switch:
        if not (isinstance(value, bool) and is_switch):
            raise InputError(f"give {'true or false' if is_switch else 'a number or a text'}")
        return [f"--{name}"] if value else []
    values = value if isinstance(value, list) else [value]
    if not values or not all(type(item) in (str, int, float) for item in values):
        raise InputError("give a number, a text, or a list of them")
    return [f"--{name}", ",".join(str(item) for item in values)]


def _rules(file: PlanFile) -> NodeRules:
    usual = NodeRules()
    shares = {
        name: _number(file, name.replace("_", "-"), 100 * share, 0, 100) / 100
        for name, share in asdict(usual.limits).items()
    }
    return NodeRules(
        tries=int(_number(file, "tries", usual.tries, 1, _MOST_TRIES, is_whole=True)),
        patience_s=_number(file, "patience", usual.patience_s, 0, MAX_SECONDS),
        limits=Limits(**shares),
    )


def _number(
    file: PlanFile, key: str, default: float, least: float, most: float, is_whole: bool = False
) -> float:
    value = file.get("nodes", key, default)
    is_number = type(value) is int or (type(value) is float and not is_whole)
    if not is_number or not least <= value <= most:
        kind = "a whole number" if is_whole else "a number"
        raise file.error(f"give {kind} from {least:g} to {most:g}", "nodes", key)
    return float(value)
