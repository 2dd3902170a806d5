"""Items of MuJoCo's changelog, and which of them fit functions."""

from pathlib import Path

import mujoco
import pytest

from mjbench.errors import InputError
from mjbench.releases import changelog
from mjbench.releases.changelog import ChangelogItem

TEXT = """\
=========
Changelog
=========

Version 2.1.0 (November 6, 2026)
--------------------------------

.. image:: images/nothing.svg
   :align: right

Engine
^^^^^^
.. admonition:: Breaking changes
   :class: attention

   1. :commit:`abc1234` Constraint :ref:`islands<option-flag-island>` are discovered by default,
      see ``mjData.nisland`` and `the manual <https://example.invalid/islands>`__.

      .. image:: images/island.svg
         :align: center

   2. Removed ``mj_foo``.

General
^^^^^^^
3. :commit:`11`, :commit:`22` Box-box collisions (:issue:`31`):

   - faster,
   - and smaller.

Not an item.

Version 2.0 (October 1, 2026)
-----------------------------
1. Something old.
"""


def test_items_are_read_without_markup() -> None:
    assert [*changelog.parse(TEXT)] == [
        ChangelogItem(
            "2.1.0",
            ("abc1234",),
            "Constraint islands are discovered by default, see mjData.nisland and the manual.",
        ),
        ChangelogItem("2.1.0", (), "Removed mj_foo."),
        ChangelogItem("2.1.0", ("11", "22"), "Box-box collisions (31): - faster, - and smaller."),
        ChangelogItem("2.0", (), "Something old."),
    ]


def test_an_item_fits_functions_whose_words_are_rare() -> None:
    items = [*changelog.parse(TEXT)]
    items += [ChangelogItem("1.0", (), f"Fixed the sensor number{i}.") for i in range(200)]
    log = changelog.Changelog(items)
    assert log.fitting("2.1.0", ["mj_island", "mj_dofIslands"]) == items[0]
    assert log.fitting("2.1.0", ["mjc_BoxBox"], ["collisions"]) == items[2]
    assert log.fitting("2.1.0", ["mj_crb"]) is None
    assert log.fitting("2.0", ["mj_island"]) is None
    assert log.fitting("9.9", ["mj_island"]) is None


def test_an_item_that_names_a_function_is_the_one_that_names_most_and_the_rarest() -> None:
    items = [
        ChangelogItem("1.0", (), "Faster mj_copyData."),
        ChangelogItem("1.1", (), "Rays: mj_ray takes a normal."),
        ChangelogItem("1.1", (), "Data: mj_copyData and mj_ray are faster."),
        ChangelogItem("1.1", (), "Nothing about rays."),
    ]
    known = changelog.Changelog(items)
    assert known.naming("1.1", ("mj_ray", "mj_copyData")) is items[2]
    assert known.naming("1.0", ("mj_ray",)) is None


def test_the_installed_changelog_has_items_of_every_release_since_the_first() -> None:
    file = Path(mujoco.__file__).parents[1] / changelog.FILE
    if not file.exists():
        pytest.skip("this MuJoCo comes without a changelog")
    items = changelog.read(file).items
    assert {"2.1.0", "3.0.0", "3.3.6", "3.8.0", "4.0.0"} <= {item.release for item in items}
    assert len(items) > 500
    assert not [item for item in items if ":ref:" in item.text or "``" in item.text]


def test_a_missing_changelog_is_an_error_in_one_line(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"cannot read .*nothing\.rst"):
        changelog.read(tmp_path / "nothing.rst")
