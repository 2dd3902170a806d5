"""The releases of a plan: which ones its names stand for, and which are compared with which."""

import itertools
from collections.abc import Callable, Collection, Sequence

from mjbench.errors import InputError, MachineError, shown, suggestion
from mjbench.releases import bundle, install_check, installs, package_index
from mjbench.releases.installs import INSTALLED, NEWEST, PREVIOUS, ReleaseSpec
from mjbench.releases.release import OLDEST, version_key
from mjbench.sweep.cells import Kind
from mjbench.sweep.plan_file import PlanFile

# The key that says which release others are compared with, and its values for the first of the plan
# and for the one before.
AGAINST, FIRST, BEFORE = "against", "first", "previous"


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


def releases(file: PlanFile, known: Callable[[], Collection[str]]) -> tuple[ReleaseSpec, ...]:
    """Return the releases in the order of the plan, `A..B` as all that were published between."""
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
    """Return a release that nodes can install; raises InputError if it is none, or a wheel."""
    spec = installs.parse_release(name)
    if spec.wheels:
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
    within = sorted(
        (version for version in versions if version_key(version) >= low), key=version_key
    )
    within = [version for version in within if high is None or version_key(version) <= high]
    if not within:
        raise InputError(f"{shown(text)}: there is no release between them")
    return [ReleaseSpec(version, version) for version in within]


def _check_exists(spec: ReleaseSpec, versions: Collection[str]) -> None:
    """Refuse a release that is neither published nor installed here."""
    apart = {name.partition("-")[0] for name in installs.install_names()}
    here = {install_check.installed_version(), *apart}
    if versions and spec.version not in versions and spec.version not in here:
        hint = suggestion(spec.version, versions)
        raise InputError(f"there is no MuJoCo {shown(spec.version)}{hint}")


def pairs(
    file: PlanFile, specs: Sequence[ReleaseSpec]
) -> tuple[tuple[ReleaseSpec, ReleaseSpec], ...]:
    """Return baseline and candidate of each comparison."""
    against = file.get(Kind.VERSIONS, AGAINST, FIRST)
    if against == BEFORE:
        return tuple(itertools.pairwise(specs))
    named = {name: spec for spec in specs for name in (spec.name, spec.version)}
    named[FIRST] = specs[0]
    if not isinstance(against, str) or against not in named:
        hint = suggestion(str(against), [FIRST, BEFORE, *named])
        text = f'give "{FIRST}", "{BEFORE}" or one of the releases{hint}'
        raise file.error(text, Kind.VERSIONS, AGAINST)
    baseline = named[against]
    return tuple((baseline, spec) for spec in specs if spec is not baseline)
