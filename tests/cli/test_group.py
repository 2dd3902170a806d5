"""What every command shares: help, version, missing packages."""

import os
import subprocess
import sys

from commands import PYTHONPATH, ROOT, mjbench


def test_help_and_version_need_no_engine() -> None:
    program = (
        "import sys; sys.argv = ['mjbench', sys.argv[1]]\n"
        "from mjbench.__main__ import main\n"
        "try: main()\nexcept SystemExit: pass\n"
        "heavy = {'mujoco', 'numpy', 'jax', 'scipy', 'msgspec', 'rich.console'}\n"
        "heavy &= set(sys.modules)\n"
        "sys.exit(f'imported {heavy}' if heavy else 0)\n"
    )
    for word in ("--help", "--version"):
        done = subprocess.run(
            [sys.executable, "-c", program, word],
            env={**os.environ, "PYTHONPATH": PYTHONPATH},
            capture_output=True, text=True, timeout=60,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        assert "mjbench" in done.stdout


def test_without_its_optional_packages_the_command_says_what_to_install() -> None:
    program = "import sys; sys.modules['click'] = None\nfrom mjbench.__main__ import main; main()"
    done = subprocess.run(
        [sys.executable, "-c", program],
        env={**os.environ, "PYTHONPATH": PYTHONPATH},
        capture_output=True, text=True, timeout=60,
    )  # fmt: skip
    assert done.returncode != 0
    assert "python -m pip install " in done.stderr
    assert "Traceback" not in done.stderr


def test_a_table_is_printed_in_any_encoding() -> None:
    run = str(ROOT / "results/runs/reference-mujoco-4.0.0.jsonl")
    done = mjbench("show", run, env={"PYTHONIOENCODING": "ascii"})
    assert done.returncode == 0, done.stderr
    assert "cartpole: 64 simulations \\xd7 200 steps" in done.stdout
