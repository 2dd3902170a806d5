"""Whose a file is: no file of mjbench is a program's, and no file of a program is mjbench's."""

import sysconfig
from pathlib import Path

import pytest

import mjbench
from mjbench.commands.lint import check as lint
from mjbench.commands.run.hook import file_owners, step_clock

STANDARD = sysconfig.get_paths()["stdlib"]
SITE = "/env/lib/python3.11/site-packages"


@pytest.mark.parametrize(
    ("file", "package", "is_of_program"),
    [
        ("/home/user/train.py", "", True),
        ("/home/user/program/hook/train.py", "", True),
        ("/home/user/mjbench/train.py", "", True),
        (f"{SITE}/gymnasium/core.py", "gymnasium", True),
        (f"{SITE}/six.py", "six", True),
        (f"{STANDARD}/json/decoder.py", file_owners.STANDARD_LIBRARY, False),
        ("<frozen importlib._bootstrap>", file_owners.STANDARD_LIBRARY, False),
        (step_clock.__file__, file_owners.MJBENCH, False),
        (lint.__file__, file_owners.MJBENCH, False),
        (f"{SITE}/mjbench/commands/run/launch.py", file_owners.MJBENCH, False),
    ],
)
def test_the_owner_of_a_file(file, package, is_of_program):
    assert file_owners.package_of(file) == package
    assert file_owners.is_own(file) == (package == "")
    assert file_owners.is_of_program(file) == is_of_program


def test_a_folder_of_mjbench_is_its_own_behind_a_link(tmp_path):
    commands = tmp_path / "linked" / "commands"
    (tmp_path / "linked").symlink_to(Path(mjbench.__file__).parent)
    assert file_owners.package_of(f"{commands}/lint/check.py") == file_owners.MJBENCH
    assert file_owners.is_of_clocks(f"{commands}/run/hook/step_clock.py")


def test_only_the_clocks_stand_for_functions_of_the_engine():
    assert file_owners.is_of_clocks(step_clock.__file__)
    assert not file_owners.is_of_clocks(lint.__file__)
    assert not file_owners.is_of_clocks("/home/user/program/hook/step_clock.py")
