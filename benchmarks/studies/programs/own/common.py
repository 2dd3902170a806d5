"""What the programs share: a model of their own, and how long their loop took."""

import sys
import time

REACHER = """
<mujoco model="reacher">
  <option timestep=".01"/>
  <worldbody>
    <geom type="plane" size="2 2 .1" pos="0 0 -.1"/>
    <body name="upper">
      <joint name="shoulder" axis="0 0 1" damping=".05"/>
      <geom type="capsule" fromto="0 0 0 .2 0 0" size=".02"/>
      <body name="lower" pos=".2 0 0">
        <joint name="elbow" axis="0 0 1" range="-160 160" damping=".05"/>
        <geom type="capsule" fromto="0 0 0 .2 0 0" size=".02"/>
        <site name="tip" pos=".2 0 0"/>
      </body>
    </body>
    <replicate count="6" euler="0 0 60">
      <body pos=".6 0 0"><freejoint/><geom type="box" size=".03 .03 .06" mass=".1"/></body>
    </replicate>
  </worldbody>
  <actuator><motor joint="shoulder" gear=".2"/><motor joint="elbow" gear=".2"/></actuator>
</mujoco>
"""
# Iterations that the program is asked for.
COUNT = int(sys.argv[1]) if len(sys.argv) > 1 else 3000


class Stopwatch:
    """Prints the seconds of a loop: `with Stopwatch(): …`."""

    def __enter__(self) -> None:
        """Begin."""
        self._begin_s = time.perf_counter()

    def __exit__(self, *_: object) -> None:
        """Print the seconds."""
        print(time.perf_counter() - self._begin_s)
