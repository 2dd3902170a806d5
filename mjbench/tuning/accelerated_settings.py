"""Settings of MJX and Warp, engines that compile the step: which are there to try on a model?"""

import math
from collections.abc import Mapping
from itertools import chain, zip_longest

import mujoco

from mjbench.simulation.work import Peaks
from mjbench.tuning.knob_values import keyword
from mjbench.tuning.settings import Setting, option

# Values to try, where they are below the present one: the most likely to help first.
ITERATIONS = (4, 1, 8, 2, 6, 3)
LS_ITERATIONS = (8, 4, 20, 6, 10)
# Solvers and Jacobians that these engines have; `auto` is one of the latter two.
SOLVERS = ("Newton", "CG")
JACOBIANS = ("dense", "sparse")
# Buffers hold this many times the contacts and constraints that C needs at most.
MARGIN = 2.0


def to_try(model: mujoco.MjModel, peaks: Peaks, default_sizes: Mapping[str, int]) -> list[Setting]:
    """Return the settings to try, of each knob in turn.

    Args:
      peaks: contacts and constraints that C needs at most.
      default_sizes: of the engine's buffers, for each simulation, by their names; empty where the
        engine sizes its buffers itself.
    """
    opt, keywords = model.opt, (("solver", SOLVERS), ("jacobian", JACOBIANS))
    by_knob = [
        [option("iterations", str(count)) for count in ITERATIONS if count < opt.iterations],
        [option("ls_iterations", str(n)) for n in LS_ITERATIONS if n < opt.ls_iterations],
        *(
            [option(name, each) for each in values if each.lower() != keyword(model, name)]
            for name, values in keywords
        ),
        *_buffers(peaks, default_sizes),
    ]
    return [setting for setting in chain(*zip_longest(*by_knob)) if setting is not None]


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
