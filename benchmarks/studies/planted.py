"""Does a check-up name the waste that was planted in a model, quiet and beside another program?

    python -m benchmarks.studies.planted [MODEL …] [--busy] [--write FOLDER]

checks models of its own, each with waste that costs a factor of two or more, and prints the first
line of each. With `--busy`, a child computes for 5 ms, sleeps for 5 ms, and so on. `--write` only
writes the models. The exit code is 1 if a first line names no remedy of what was planted, or a
check-up takes more than 66 s.
"""

import argparse
import contextlib
import multiprocessing
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mjbench.status import ExitCode

MOST_S = 66.0
_BUSY_S = 0.005


@dataclass(frozen=True)
class Planted:
    """A model with waste, and the remedies of which the first line must name one."""

    mjcf: Callable[[], str]
    remedies: tuple[str, ...]


def _legs(count: int) -> str:
    """Return legs of two segments on a trunk."""
    return "".join(
        f'<body name="upper{i}" pos="{0.3 * np.cos(a):.3f} {0.3 * np.sin(a):.3f} 0">'
        f'<joint axis="{-np.sin(a):.3f} {np.cos(a):.3f} 0" range="-0.6 0.6"/>'
        '<geom type="capsule" fromto="0 0 0 0 0 -0.25" size="0.04"/>'
        f'<body name="lower{i}" pos="0 0 -0.25"><joint axis="1 0 0" range="-0.8 0.8"/>'
        '<geom type="capsule" fromto="0 0 0 0 0 -0.25" size="0.03"/></body></body>'
        for i, a in enumerate(np.linspace(0, 2 * np.pi, count, endpoint=False))
    )


def _walker(count: int, head: str, tail: str = "") -> str:
    motors = "".join(f'<position joint="j{i}" kp="20" kv="1"/>' for i in range(2 * count))
    legs = _legs(count)
    for i in range(2 * count):
        legs = legs.replace("<joint axis", f'<joint name="j{i}" damping="0.5" axis', 1)
    return (
        f'<mujoco>{head}<worldbody><geom type="plane" size="0 0 1"/>'
        f'<body name="trunk" pos="0 0 0.6"><freejoint/><geom type="cylinder" size="0.3 0.05"/>'
        f"{legs}</body></worldbody><actuator>{motors}</actuator>{tail}</mujoco>"
    )


def rk4() -> str:
    """Return a walker with RK4 at half a millisecond."""
    return _walker(6, '<option integrator="RK4" timestep="0.0005"/>')


def noslip() -> str:
    """Return a pile of boxes with elliptic cones and many iterations against slip."""
    boxes = "".join(
        f'<body pos="{0.3 * (i % 4)} {0.3 * (i // 4 % 3)} {0.15 + 0.25 * (i // 12)}"><freejoint/>'
        '<geom type="box" size="0.1 0.1 0.1"/></body>'
        for i in range(18)
    )
    option = '<option cone="elliptic" noslip_iterations="60" noslip_tolerance="0"/>'
    return (
        f'<mujoco>{option}<worldbody><geom type="plane" size="0 0 1"/>{boxes}</worldbody></mujoco>'
    )


def static() -> str:
    """Return a cart in a city of fixed boxes."""
    houses = "".join(
        f'<geom type="box" size="0.3 0.3 {0.5 + 0.1 * (i % 7)}" pos="{x} {y} 0.5"/>'
        for i, (x, y) in enumerate((x, y) for x in range(-32, 33) for y in range(-32, 33) if y)
    )
    return (
        f'<mujoco><option timestep="0.002"/><worldbody>{houses}<body pos="0 0 0.2">'
        '<joint name="drive" type="slide" axis="1 0 0" damping="1"/>'
        '<geom type="box" size="0.2 0.1 0.1"/></body></worldbody>'
        '<actuator><motor joint="drive" ctrlrange="-1 1"/></actuator></mujoco>'
    )


def tendons() -> str:
    """Return a walker with tendons that nothing uses."""
    sites = range(60)
    paths = "".join(
        f'<spatial name="t{i}_{k}"><site site="a"/><site site="b{k}"/><site site="a"/></spatial>'
        for i in sites
        for k in range(4)
    )
    walker = _walker(4, "", f"<tendon>{paths}</tendon>").replace(
        "<freejoint/>", '<freejoint/><site name="a"/>', 1
    )
    for k in range(4):
        walker = walker.replace(
            f'<body name="lower{k}" pos="0 0 -0.25">',
            f'<body name="lower{k}" pos="0 0 -0.25"><site name="b{k}"/>',
        )
    return walker


def _stone(*half_m: float) -> str:
    """Return an asset: an ellipsoid of 2,000 vertices, all of them on its convex hull."""
    points = np.random.default_rng(0).standard_normal((2000, 3))
    points *= np.array(half_m) / np.linalg.norm(points, axis=1, keepdims=True)
    vertices = " ".join(f"{value:.4f}" for value in points.ravel())
    return f'<asset><mesh name="stone" vertex="{vertices}"/></asset>'


def meshes() -> str:
    """Return fingers whose meshes have many vertices, and are near each other without touching."""
    fingers = "".join(
        f'<body name="f{i}" pos="{0.14 * (i % 4) + 0.07 * (i // 4 % 2)} {0.07 * (i // 4)} 1">'
        f'<joint name="j{i}"'
        ' axis="1 0 0" range="-5 5" limited="true" damping="0.1"/>'
        '<geom type="mesh" mesh="stone"/></body>'
        for i in range(12)
    )
    motors = "".join(f'<position joint="j{i}" kp="1" ctrlrange="-0.05 0.05"/>' for i in range(12))
    return (
        '<mujoco><option><flag nativeccd="disable"/></option>'
        f"{_stone(0.04, 0.04, 0.2)}<worldbody>{fingers}</worldbody>"
        f"<actuator>{motors}</actuator></mujoco>"
    )


def stones() -> str:
    """Return falling meshes of many vertices: what is faster changes the motion."""
    bodies = "".join(
        f'<body pos="{0.3 * (i % 3)} {0.3 * (i // 3)} {0.2 + 0.05 * i}"><freejoint/>'
        '<geom type="mesh" mesh="stone"/></body>'
        for i in range(9)
    )
    return (
        f'<mujoco><option><flag nativeccd="disable"/></option>{_stone(0.2, 0.15, 0.1)}<worldbody>'
        f'<geom type="box" size="2 2 0.1" pos="0 0 -0.1"/>{bodies}</worldbody></mujoco>'
    )


MODELS = {
    "rk4": Planted(rk4, ("integrator=", "timestep=")),
    "noslip": Planted(noslip, ("noslip_iterations=", "cone=")),
    "static": Planted(static, ("sleep=",)),
    "tendons": Planted(tendons, ("unused tendons",)),
    "meshes": Planted(meshes, ("exclude ", "nativeccd=", "maxhullvert=")),
    "stones": Planted(stones, ("simpler or fewer geoms",)),
}


def _burn() -> None:
    while True:
        end_s = time.perf_counter() + _BUSY_S
        while time.perf_counter() < end_s:
            pass
        time.sleep(_BUSY_S)


@contextlib.contextmanager
def busy(is_busy: bool) -> Iterator[None]:
    """Keep a core half busy, by a child that ends with the block."""
    child = multiprocessing.get_context("spawn").Process(target=_burn, daemon=True)
    if is_busy:
        child.start()
    try:
        yield
    finally:
        if is_busy:
            child.terminate()
            child.join()


def checked(name: str, folder: Path) -> bool:
    """Check a model; print its first line; return whether that names the planted waste in time."""
    file = folder / f"{name}.xml"
    file.write_text(MODELS[name].mjcf(), encoding="utf-8")
    begin_s = time.monotonic()
    command = [sys.executable, "-m", "mjbench", str(file)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    seconds = time.monotonic() - begin_s
    _, _, summary = done.stdout.rpartition(f"{name}.xml: what to do first")
    lines = [line for line in summary.splitlines() if line.startswith(f"{name}.xml: ")]
    first = lines[0] if lines else (done.stderr.splitlines() or [""])[-1]
    is_right = any(remedy in first for remedy in MODELS[name].remedies) and seconds <= MOST_S
    print(f"{'right' if is_right else 'WRONG'} {seconds:.0f} s: {first}", flush=True)
    return is_right


def main() -> ExitCode:
    """Run the command; return its exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("models", nargs="*", choices=[[], *MODELS], metavar="MODEL")
    parser.add_argument("--busy", action="store_true")
    parser.add_argument("--write", type=Path, metavar="FOLDER")
    options = parser.parse_args()
    if options.write:
        for name, planted in MODELS.items():
            (options.write / f"{name}.xml").write_text(planted.mjcf(), encoding="utf-8")
        return ExitCode.OK
    with busy(options.busy), tempfile.TemporaryDirectory() as folder:
        results = [checked(name, Path(folder)) for name in options.models or MODELS]
    return ExitCode.OK if all(results) else ExitCode.FINDING


if __name__ == "__main__":
    sys.exit(main())
