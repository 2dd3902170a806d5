"""Small models that tests of tuning share."""

# Overlapping geoms: parent and child, a welded body, geoms of other contypes, an excluded pair.
GEOMETRY = """
<mujoco>
  <worldbody>
    <geom type="sphere" size=".3"/>
    <body name="parent" pos=".01 0 0">
      <joint/><geom size=".3"/><geom size=".2" contype="2" conaffinity="2"/>
      <body name="child" pos="0 .01 0">
        <joint/><geom size=".3"/>
        <body name="welded" pos="0 0 .01">
          <geom size=".3"/>
          <body name="grandchild"><joint/><geom size=".3" pos=".02 .02 0"/></body>
        </body>
      </body>
    </body>
    <body name="free" pos="0 0 .02"><freejoint/><geom size=".3"/></body>
    <body name="other" pos="0 .02 0"><joint/><geom size=".3" contype="4" conaffinity="2"/></body>
    <body name="static" pos="0 .03 0"><geom size=".3"/></body>
  </worldbody>
  <contact><exclude body1="free" body2="child"/></contact>
</mujoco>
"""


def rods(na: int, nb: int, options: str = "") -> str:
    """Return rods that spin about themselves, side by side; only `a` may collide with `b`.

    Each is near every other, and touches none.
    """
    rod = (
        "<body name='{kind}{index}' pos='0 {y} 0' euler='0 0 45'><joint axis='1 0 0'/>"
        "<geom type='capsule' size='.01' fromto='0 0 0 3 0 0' contype='{own}'"
        " conaffinity='{other}'/></body>"
    )
    a = (rod.format(kind="a", index=i, y=-0.05 * i, own=1, other=2) for i in range(na))
    b = (rod.format(kind="b", index=i, y=0.05 * (i + 1), own=2, other=1) for i in range(nb))
    return f"<mujoco><option {options}/><worldbody>{''.join(a)}{''.join(b)}</worldbody></mujoco>"


# The rods lie diagonally, 0.05 m apart along y. This is the distance between their surfaces.
ROD_GAP_M = 0.05 / 2**0.5 - 2 * 0.01
