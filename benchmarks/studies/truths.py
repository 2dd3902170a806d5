"""Does `mjbench versions` find changes that are known from issues and release notes?

    python -m benchmarks.studies.truths [NAME …] [--write]

compares pairs of environments, in one of which some work is known to take more time or memory. Each
has a control that should be `same`: other work in these environments, or this work in two others.

A comparison takes up to five minutes, after the installation of its environments. With --write,
each pair is stored once it is finished, and is not measured again unless it is named. The exit code
is 1 if a change is missed or a control differs, and 0 otherwise.
"""

import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from benchmarks.studies import stored_run, tally_command, tally_file
from benchmarks.studies.page_part import PagePart
from benchmarks.studies.truth_tally import Answer, Truth, TruthResult, TruthTally
from mjbench.errors import MachineError
from mjbench.host import machine
from mjbench.status import ExitCode

FOLDER = Path(__file__).parent / "programs" / "truths"
TALLY = Path(__file__).parents[2] / "results/truths.json"
PART = PagePart("method/errors.md", "truths", "benchmarks.studies.truths")


def _jax(version: str) -> str:
    return f"jax=={version},jaxlib=={version},numpy==2.1.3,scipy==1.14.1"


def _warp(version: str) -> str:
    return f"mujoco=={version},mujoco-warp=={version},warp-lang==1.12.1"


_NUMPY = ("numpy==2.3.5", "numpy==2.4.0")
_JAX, _OLD_JAX = (_jax("0.7.0"), _jax("0.7.1")), (_jax("0.4.31"), _jax("0.4.33"))
_WARP = (_warp("3.7.0"), _warp("3.8.0"))
_LONGER = ("--budget", "300s")
_SIZES = ("--settle", "0", "--nbatch", "1", "--nstep", "10")
_MEMORY = ("--metric", "memory", *_SIZES)
_NUMPY_NOTES = "its notes", "https://numpy.org/doc/stable/release/2.4.0-notes.html"
_MUJOCO_CHANGES = "changelog", "https://mujoco.readthedocs.io/en/stable/changelog.html"
_ARRAY = "numpy_small.py::array"
TRUTHS = (
    Truth(
        "NumPy 2.4.0: functions of single numbers",
        (*_NUMPY, "numpy_small.py::scalars"),
        1 / 6,
        False,
        _NUMPY_NOTES,
        (*_NUMPY, _ARRAY),
    ),
    Truth(
        "NumPy 2.4.0: `ndindex`",
        (*_NUMPY, "numpy_small.py::indices"),
        1 / 5.2,
        False,
        _NUMPY_NOTES,
        (*_NUMPY, _ARRAY),
    ),
    Truth(
        "NumPy 2.4.0: `unique` of complex numbers",
        (*_NUMPY, "numpy_small.py::unique_complex"),
        1 / 1.45,
        False,
        _NUMPY_NOTES,
        (*_NUMPY, "numpy_small.py::sort_complex"),
    ),
    Truth(
        "JAX 0.7.1: a loop sets random elements of an array",
        (*_JAX, "jax_carried_array.py::random_elements", *_LONGER),
        5.5,
        True,
        ("jax#31284", "https://github.com/jax-ml/jax/issues/31284"),
        (*_JAX, "jax_carried_array.py::computed_elements", *_LONGER),
    ),
    Truth(
        "JAX 0.4.33: a scan carries a 3 × 3 matrix in float64",
        (*_OLD_JAX, "jax_small_scan.py::covariances", *_LONGER),
        10.0,
        True,
        ("jax#36799", "https://github.com/jax-ml/jax/issues/36799"),
        (*_OLD_JAX, _ARRAY),
    ),
    Truth(
        "JAX 0.4.33: a loop carries two numbers",
        (*_OLD_JAX, "jax_small_scan.py::count", *_LONGER),
        21.0,
        True,
        ("jax#25190", "https://github.com/jax-ml/jax/issues/25190"),
        (*_OLD_JAX, _ARRAY),
    ),
    Truth(
        "MuJoCo Warp 3.8.0: collisions, on a CPU",
        (*_WARP, "warp_steps.py::collide", *_LONGER),
        None,
        True,
        ("mujoco_warp#1321", "https://github.com/google-deepmind/mujoco_warp/issues/1321"),
        (*_WARP, "warp_steps.py::kinematics", *_LONGER),
    ),
    Truth(
        "MuJoCo 3.2.4: peak memory of 300 spheres, with Newton",
        ("3.2.3", "3.2.4", "spheres.xml", *_MEMORY),
        None,
        False,
        _MUJOCO_CHANGES,
        ("3.3.1", "3.3.2", "spheres.xml", *_MEMORY),
    ),
)


def ask(arguments: Sequence[str]) -> Answer:
    """Return what `mjbench versions` answers.

    Raises:
      MachineError: it stored no verdict, or several.
    """
    # late: asv imports this module where few packages are
    from mjbench.paired.records import VerdictRecord

    load = machine.describe().load_1min
    run = stored_run.run_of("versions", arguments, FOLDER)
    records = run.of_type(VerdictRecord)
    if len(records) != 1:
        raise MachineError(f"mjbench versions {' '.join(arguments)}: {len(records)} verdicts")
    row = records[0].row()
    return Answer(tuple(arguments), row.verdict, row.ratio, row.seconds, load, row.detail)


def measure(truths: Sequence[Truth], tally: TruthTally, writes: bool) -> TruthTally:
    """Ask about changes, one after the other; return all answers.

    Args:
      writes: whether to store them after each change.
    """
    for truth in truths:
        result = TruthResult(ask(truth.arguments), ask(truth.control))
        print(f"{result.row(truth)} {result.seconds:.0f} s", flush=True)
        others = [each for each in tally.results if not each.is_of(truth)]
        tally = replace(tally, results=[*others, result])
        if writes:
            tally_file.write(TALLY, tally)
            PART.write(tally.lines(TRUTHS))
    return tally


def main() -> ExitCode:
    """Run the command; return its exit code."""
    parser = tally_command.parser(__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help="part of what changed")
    parser.add_argument("--write", action="store_true", help=f"write {TALLY.name} and the page")
    options = parser.parse_args()
    for name in options.names:
        if not any(name in truth.name for truth in TRUTHS):
            parser.error(f"{name}: names are {'; '.join(truth.name for truth in TRUTHS)}")
    here = machine.describe()
    tally = TruthTally(here.versions["mujoco"], here.cpu, here.usable_cores, [])
    if options.write:
        tally = tally_file.continued(TALLY, tally, "changes")
    known = [truth for truth, _ in tally.known(TRUTHS)]
    chosen = [
        truth
        for truth in TRUTHS
        if any(name in truth.name for name in options.names)
        or not (options.names or truth in known)
    ]
    tally = measure(chosen, tally, options.write)
    print("\n".join(tally.lines(TRUTHS)))
    are_right = all(
        each.is_found(truth) and each.has_control for truth, each in tally.known(TRUTHS)
    )
    return ExitCode.OK if are_right else ExitCode.FINDING


if __name__ == "__main__":
    sys.exit(tally_command.run("truths", main, "pairs that were finished are stored"))
