"""The names of the settings that `mjbench tune` tries, in groups; help has them without MuJoCo."""

from collections.abc import Mapping, Sequence

from mjbench.errors import InputError, shown, suggestion

# By the name of a group. Each is the name of a knob (see `knobs.KNOBS`), which has its values. A
# name that is also that of a group stands for the group.
GROUPS: Mapping[str, Sequence[str]] = {
    "solver": (
        *("solver", "iterations", "ls_iterations", "tolerance", "noslip_iterations", "warmstart"),
        *("jacobian", "island", "diagexact"),
    ),
    "contact": (
        *("cone", "excludes", "midphase", "nativeccd", "multiccd", "ccd_iterations"),
        *("ccd_tolerance", "override", "speculative", "sdf_iterations"),
        *("sdf_initpoints", "maxhullvert"),
    ),
    "integration": ("timestep", "integrator", "eulerdamp"),
    "features": (
        *("unused_features", "sensor", "energy", "fwdinv", "autoreset", "sleep", "visual_geoms"),
        *("tendons", "fusestatic"),
    ),
    "program": ("timer", "engine_threads"),
}
NAMES = tuple(name for names in GROUPS.values() for name in names)
IN_GROUPS = "; ".join(f"{group} ({', '.join(names)})" for group, names in GROUPS.items())


def chosen(only: Sequence[str], skip: Sequence[str]) -> tuple[str, ...]:
    """Return the names of the settings to try.

    Args:
      only: names and groups to try; none for all.
      skip: names and groups to leave alone.

    Raises:
      InputError: one is no name and no group, or nothing is left.
    """
    skipped = set(_named(skip))
    names = tuple(name for name in _named(only) or NAMES if name not in skipped)
    if not names:
        raise InputError("no setting is left to try: --skip names all that --only does")
    return names


def _named(words: Sequence[str]) -> list[str]:
    names: list[str] = []
    for word in words:
        if word not in GROUPS and word not in NAMES:
            near = suggestion(word, [*GROUPS, *NAMES])
            raise InputError(f"no setting {shown(word)}{near}: see `mjbench tune --help`")
        names += GROUPS.get(word, (word,))
    return list(dict.fromkeys(names))
