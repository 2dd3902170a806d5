"""Does the constraint solver of a model converge, and the same model with one that does.

A solver that stops at its limit of iterations before it converges makes results depend on that
limit: `mjbench tune` says so first.
"""

import copy

import mujoco

from mjbench.simulation import compat, model_options

# The solver is said not to converge if it stops at its limit in more than this share of the steps.
MOST_LIMITED = 0.05
# The converged solver: its tolerance, and its least numbers of iterations.
TOLERANCE, ITERATIONS, LS_ITERATIONS = 1e-15, 200, 100


def converged(model: mujoco.MjModel, refinement: int = 1) -> mujoco.MjModel:
    """Return the model with a solver that converges, at a fraction of its timestep."""
    tight = copy.copy(model)
    opt = tight.opt
    opt.timestep = float(opt.timestep) / refinement
    opt.solver = mujoco.mjtSolver.mjSOL_NEWTON
    opt.tolerance = TOLERANCE
    opt.iterations = max(int(opt.iterations), ITERATIONS)
    for name, least in (("ls_iterations", LS_ITERATIONS), ("ccd_iterations", ITERATIONS)):
        if hasattr(opt, name):
            setattr(opt, name, max(int(getattr(opt, name)), least))
    if opt.noslip_iterations:
        opt.noslip_iterations, opt.noslip_tolerance = ITERATIONS, TOLERANCE
    if compat.flag_enabled(tight, "sleep"):
        model_options.set_flag(opt, "sleep", "disable")
    return tight
