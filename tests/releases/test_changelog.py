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


# Items of MuJoCo's changelog, shortened, and functions whose cost changed with them.
ISLANDS = ChangelogItem(
    "3.3.6",
    (),
    "Constraint island discovery and construction, previously an experimental feature, is now"
    " documented and promoted to default; disable it with option/flag/island.",
)
STACK = ChangelogItem("3.0.0", (), "Renamed mj_stackAlloc to mj_stackAllocNum. The new function …")
MACROS = ChangelogItem(
    "3.0.0", (), "Removed the macros mjMARKSTACK and mjFREESTACK. **Migration** …"
)
TREES = ChangelogItem(
    "3.0.0",
    (),
    "Fixed a bug that was causing geom margin to be ignored during the construction of midphase"
    " collision trees.",
)
JACOBIAN = ChangelogItem(
    "3.6.0", (), "The tendon Jacobian ten_J is now always sparse. The fields …"
)
BOX_QP = ChangelogItem(
    "3.17.0",
    (),
    "mju_boxQP now updates its Cholesky factor incrementally with mju_cholUpdate, making …",
)
FLEX = ChangelogItem(
    "3.16.0",
    (),
    "Flex contacts are now reduced to mjMAXCONPAIR per geom only for rigid and interpolated flexes;"
    " other flexes keep all their contacts.",
)
DISCRETE = ChangelogItem(
    "3.13.0",
    (),
    "Added a new integrator discrete: the constraint solve and the implicit velocity update merge"
    " into one operation.",
)
HULL = ChangelogItem(
    "3.3.5",
    (),
    "Fixed a bug where the convex hull of a collision mesh was not being computed if the mesh could"
    " only collide via a contact pair.",
)
GUIDE = ChangelogItem(
    "4.0.0",
    (),
    "Added a Model tuning guide to the Modeling chapter---covering the fidelity--speed trade-off,"
    " tuning defaults, priority-ordered global and model-level parameters.",
)
RAYS = ChangelogItem(
    "3.5.0",
    (),
    "Ray-cast functions now optionally compute the surface normal at the ray intersection. The"
    " modified functions are mj_ray, mj_multiRay and mju_rayGeom.",
)
BATCH = ChangelogItem(
    "3.17.0",
    (),
    "Added a mujoco.batch module over the batch API: Batch(model, nsim) with live arrays, step,"
    " forward, reset, set_const and rollout with the GIL released.",
)
COPY = ChangelogItem(
    "3.2.0",
    (),
    "Fix an issue where mj_copyData (or copy.copy() in the Python bindings) was not copying contact"
    " information correctly.",
)
TEXTURE = ChangelogItem(
    "3.2.3", (), "Added an mjSpec option for creating a texture directly from a buffer."
)
REAL = (ISLANDS, STACK, MACROS, TREES, JACOBIAN, BOX_QP, FLEX, DISCRETE, HULL, GUIDE, RAYS, BATCH)


@pytest.fixture(scope="module")
def log() -> changelog.Changelog:
    """Return real items among many others, of which some are about an mjSpec."""
    others = [f"Improved the {word}." for word in ("viewer", "compiler", "mjSpec", "plugin")]
    items = [ChangelogItem("1.0", (), text) for text in others for _ in range(100)]
    return changelog.Changelog([*REAL, COPY, TEXTURE, *items])


@pytest.mark.parametrize(
    ("item", "differences"),
    [
        (ISLANDS, {"mju_blockDiag": 1.5, "mj_island": 1.4, "mju_blockDiagSparse": 1.1}),
        (ISLANDS, {"mju_cholUpdate": -8.8, "mj_island": 2.9, "mju_blockDiag": 1.9}),
        (STACK, {"stackalloc": 1.2, "add_pair": 1.2, "mj_SAP": 0.8}),
        (MACROS, {"mj_collideTree": 1.0, "CGupdateConstraint": 0.8, "mj_markStack": 0.6}),
        (JACOBIAN, {"mj_jacSparse": 7.1, "mj_jac": -5.0, "mj_jacDifPair": 4.5}),
    ],
)
def test_an_item_fits_a_function_that_it_names_or_has_all_parts_of(
    log: changelog.Changelog, item: ChangelogItem, differences: dict[str, float]
) -> None:
    assert log.fitting(item.release, differences) is item
    assert log.fitting("2.0", differences) is None


@pytest.mark.parametrize(
    ("release", "differences"),
    [
        # a common word: tree, sparse, collision, constraint and update, global
        ("3.0.0", {"mj_collideTree": 1.3, "CGupdateConstraint": 1.2}),
        ("3.6.0", {"mju_mulMatVecSparse": 15.2, "mj_solPrimal": 8.7, "PrimalEval": 7.0}),
        ("3.3.5", {"__memcpy_avx_unaligned_erms": -0.5, "mj_collideOBB": 0.4}),
        ("3.13.0", {"PrimalUpdateConstraint": -2.4, "mju_superSparse": 0.5}),
        ("4.0.0", {"__ieee754_atan2_fma": 4.8, "mj_local2GlobalQuat": 1.1}),
        # it begins with another function
        ("3.17.0", {"mju_cholUpdate": -14.3, "HessianConeUpdate": 7.1, "mj_solPrimal": 6.3}),
        # the function is a small part of the change
        ("3.13.0", {"mju_sqrMatTD_impl": -4.9, "mj_constraintUpdate": 0.4}),
        ("3.3.6", {"mju_sqrMatTD_impl": -9.9, "mj_island": 0.4}),
        ("3.3.6", {}),
    ],
)
def test_an_item_that_shares_a_common_word_fits_nothing(
    log: changelog.Changelog, release: str, differences: dict[str, float]
) -> None:
    assert log.fitting(release, differences) is None


def test_an_item_that_begins_with_a_counter_fits_where_no_function_does(
    log: changelog.Changelog,
) -> None:
    differences = {"mju_mulMatVecSparse": -10.5, "PrimalEval": -6.7}
    assert log.fitting("3.16.0", differences, ["contacts", "constraints"]) is FLEX
    assert log.fitting("3.16.0", differences, ["constraints"]) is None
    assert log.fitting("3.3.5", differences, ["contacts"]) is None  # a detail of another item


def test_an_item_is_about_an_operation_that_it_names(log: changelog.Changelog) -> None:
    assert log.naming("3.2.0", ("mj_copyData",)) is COPY
    assert log.naming("3.5.0", ("mj_ray",)) is RAYS
    assert log.naming("3.17.0", ("batch", "Batch")) is BATCH
    assert log.naming("3.17.0", ("rollout",)) is None  # one of many things in a list
    assert log.naming("3.2.3", ("MjSpec", "mjSpec")) is None  # many items name it
    assert log.naming("9.9", ("mj_ray",)) is None


def test_of_items_that_name_an_operation_the_one_with_most_names_is_taken() -> None:
    items = [
        ChangelogItem("1.1", (), "Rays: mj_ray takes a normal."),
        ChangelogItem("1.1", (), "Data: mj_copyData and mj_ray are faster."),
        *(ChangelogItem("1.0", (), f"Nothing {i}.") for i in range(200)),
    ]
    known = changelog.Changelog(items)
    assert known.naming("1.1", ("mj_ray", "mj_copyData")) is items[1]
    assert known.naming("1.1", ("mj_ray",)) is not None
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
