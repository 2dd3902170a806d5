"""Settings of MJX and Warp, engines that compile the step: which are there to try on a model?"""

import math
from collections.abc import Mapping, Sequence
from itertools import chain, zip_longest

import mujoco

from mjbench.simulation.work import Peaks
from mjbench.tuning.settings import Edit, Part, Setting

# Values to try, where they are below the present one: the most likely to help first.
ITERATIONS = (4, 1, 8, 2, 6, 3)
LS_ITERATIONS = (8, 4, 20, 6, 10)
# Solvers and Jacobians that these engines have; `auto` is one of the latter two.
SOLVERS = ("newton", "cg")
JACOBIANS = ("dense", "sparse")
# Buffers hold this many times the contacts and constraints that C needs at most.
MARGIN = 2.0


def to_try(model: mujoco.MjModel, peaks: Peaks, default_sizes: Mapping[str, int]) -> list[Setting]:
    """Return the settings to try, of each knob in turn.

    Args:
      model: with the present settings.
      peaks: contacts and constraints that C needs at most.
      default_sizes: of the engine's buffers, for each simulation, by their names; empty where the
        engine sizes its buffers itself.
    """
    by_knob = [
        _counts("iterations", ITERATIONS, int(model.opt.iterations)),
        _counts("ls_iterations", LS_ITERATIONS, int(model.opt.ls_iterations)),
        _others("solver", SOLVERS, _name("mjtSolver", "mjSOL_", model.opt.solver)),
        _others("jacobian", JACOBIANS, _name("mjtJacobian", "mjJAC_", model.opt.jacobian)),
        *_buffers(peaks, default_sizes),
    ]
    return [setting for setting in chain(*zip_longest(*by_knob)) if setting is not None]


def _counts(knob: str, values: Sequence[int], present: int) -> list[Setting]:
    """Return smaller limits of iterations than the present one."""
    return [_option(knob, str(value)) for value in values if value < present]


def _others(knob: str, values: Sequence[str], present: str) -> list[Setting]:
    """Return the values that are not the present one."""
    return [_option(knob, value) for value in values if value != present]


def _option(knob: str, value: str) -> Setting:
    text = "CG" if value == "cg" else "Newton" if value == "newton" else value
    return Setting(knob, f"{knob}={text}", (Edit(Part.OPTION, knob, text),))


def _buffers(peaks: Peaks, default_sizes: Mapping[str, int]) -> list[list[Setting]]:
    """Return smaller buffers than the engine's own, with room for what C needs and a margin."""
    needs = {"nconmax": ("contacts", peaks.contacts), "njmax": ("constraints", peaks.constraints)}
    smaller = []
    for name, default in default_sizes.items():
        what, need = needs[name]
        size = max(1, math.ceil(MARGIN * need))
        if size < default:
            evidence = f"{need} {what} at most in C; the engine makes room for {default}"
            smaller.append(
                [Setting(name, f"{name}={size}", evidence=evidence, buffer_sizes={name: size})]
            )
    return smaller


def _name(enum: str, prefix: str, value: int) -> str:
    """Return the name of an enum's value, as MjOption has it, such as `newton`."""
    kind = getattr(mujoco, enum)
    names = [n for n in dir(kind) if n.startswith(prefix) and int(getattr(kind, n)) == int(value)]
    return names[0].removeprefix(prefix).lower()
