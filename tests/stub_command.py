"""A stand-in for `mjbench profile --instructions` on a node: a record a release, and it can hang.

    python stub_command.py FOLDER instructions --release R … --results DIR -- MODEL

Where FOLDER/hang-MODEL exists, the first try of that model stops before its last record.
"""

import signal
import sys
from pathlib import Path

from mjbench.counts.records import InstructionsRecord
from mjbench.host import child, machine
from mjbench.store import runs
from mjbench.store.run_writer import RunFile
from mjbench.store.runs import RunHeader


def main() -> None:
    child.die_with_parent()
    folder, arguments = Path(sys.argv[1]), sys.argv[2:]
    releases = [arguments[i + 1] for i, argument in enumerate(arguments) if argument == "--release"]
    results, model = Path(arguments[arguments.index("--results") + 1]), arguments[-1]
    hangs = folder / f"hang-{model}"
    header = RunHeader(runs.SCHEMA, arguments[0], machine.describe(), {})
    file = RunFile.create(results, header)
    for release in releases:
        if release == releases[-1] and hangs.exists():
            hangs.unlink()
            (folder / f"hanging-{model}").touch()
            signal.pause()
        file.append(InstructionsRecord(model=model, release=release, instructions_per_step=1.0))
    file.close()


if __name__ == "__main__":
    main()
