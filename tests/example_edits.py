"""Edits of MJCF that several tests share."""

import mujoco

from mjbench.tuning.mjcf_edit import edited
from mjbench.tuning.settings import Edit, Part

BODIES = """<worldbody>
    <body name="a"><freejoint/><geom size=".1"/></body>
    <body name="b" pos="0 0 1"><freejoint/><geom size=".1"/></body>
    <body name="c" pos="0 0 2"><freejoint/><geom size=".1"/></body>
  </worldbody>"""
CG = Edit(Part.OPTION, "solver", "CG")
STEP = Edit(Part.OPTION, "timestep", "0.003")
NO_ISLAND = Edit(Part.FLAG, "island", "disable")
ENERGY = Edit(Part.FLAG, "energy", "enable")
FUSE = Edit(Part.COMPILER, "fusestatic", "true")
EXCLUDE = Edit(Part.EXCLUDE, "a", "b")
ALL = (CG, STEP, NO_ISLAND, ENERGY, FUSE, EXCLUDE)


def checked_edit(text: str, *edits: Edit) -> str:
    """Return the edited text, after a check that editing twice changes nothing more."""
    once = edited(text.encode(), edits)
    assert edited(once, edits) == once
    return once.decode()


def disables(model: mujoco.MjModel, flag: str) -> bool:
    bit = getattr(mujoco.mjtDisableBit, f"mjDSBL_{flag.upper()}")
    return bool(model.opt.disableflags & int(bit))
