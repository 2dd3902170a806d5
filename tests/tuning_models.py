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


# The rods of benchmarks.studies.tuning_planted lie diagonally, 0.05 m apart along y. This is the
# distance between their surfaces.
ROD_GAP_M = 0.05 / 2**0.5 - 2 * 0.01
