"""A plan is checked before anything runs: what is wrong is one line, with its place."""

import re
from pathlib import Path

import pytest
from commands import ROOT
from example_models import CONTACT_XML
from hypothesis import given
from hypothesis import strategies as st
from sweep_examples import plan_file

from mjbench.cli.sweep import check_command
from mjbench.errors import InputError
from mjbench.paired.metrics import Metric
from mjbench.simulation import models
from mjbench.sweep import plan as plans
from mjbench.sweep.busy_node import NodeRules
from mjbench.sweep.cells import CellKind
from mjbench.sweep.plan import Plan

VERSIONS = frozenset({"3.3.0", "3.5.0", "3.9.0", "3.17.0", "4.0.0"})
RELEASES = 'releases = ["3.3.0", "4.0.0"]\n'


def load(folder: Path, text: str) -> Plan:
    return plans.load(plan_file(folder, text), check_command, lambda: VERSIONS)


def test_two_releases_are_enough_of_a_plan(tmp_path: Path) -> None:
    plan = load(tmp_path, RELEASES)
    assert [source.name for source in plan.models] == models.shipped()
    assert [(old.version, new.version) for old, new in plan.pairs] == [("3.3.0", "4.0.0")]
    assert (plan.paths, plan.metrics, plan.machines) == (("python_loop",), (Metric.TIME,), ())
    assert list(plan.options) == [CellKind.VERSIONS]
    assert plan.rules == NodeRules()


def test_a_plan_can_have_everything(tmp_path: Path) -> None:
    plan = load(
        tmp_path,
        """
models = ["cartpole", "humanoid"]
releases = ["3.3.0", "3.9.0..4.0.0"]
paths = ["python_loop", "rollout"]
metrics = ["time", "p99"]
machines = ["epyc", "xeon"]

[versions]
against = "previous"
min-effect = "2%"
time-limit = 30
as-shipped = true
nbatch = 8

[compare]
paths = ["rollout", "batch_step"]
threads = [1, 2]
budget = "4s"

[instructions]
nstep = 20
hold = 5

[history]

[nodes]
tries = 5
patience = 60
min-cores = 90
max-busy = 10
max-stolen = 0
""",
    )
    assert [spec.version for spec in plan.releases] == ["3.3.0", "3.9.0", "3.17.0", "4.0.0"]
    assert [(old.version, new.version) for old, new in plan.pairs] == [
        ("3.3.0", "3.9.0"),
        ("3.9.0", "3.17.0"),
        ("3.17.0", "4.0.0"),
    ]
    assert plan.machines == ("epyc", "xeon")
    options = {kind: " ".join(given) for kind, given in plan.options.items()}
    assert options == {
        CellKind.VERSIONS: "--min-effect 2% --time-limit 30 --as-shipped --nbatch 8",
        CellKind.COMPARE: "--paths rollout,batch_step --threads 1,2 --budget 4s",
        CellKind.INSTRUCTIONS: "--nstep 20 --hold 5",
        CellKind.HISTORY: "",
    }
    limits = plan.rules.limits
    assert (plan.rules.tries, plan.rules.patience_s) == (5, 60.0)
    assert (limits.min_cores, limits.max_busy, limits.max_stolen) == (0.9, 0.1, 0.0)


def test_a_release_can_be_the_one_that_all_are_compared_with(tmp_path: Path) -> None:
    text = 'releases = ["3.3.0", "3.9.0", "4.0.0"]\n[versions]\nagainst = "3.9.0"\n'
    pairs = load(tmp_path, text).pairs
    assert [(old.version, new.version) for old, new in pairs] == [
        ("3.9.0", "3.3.0"),
        ("3.9.0", "4.0.0"),
    ]


def test_a_switch_that_is_off_by_default_can_be_given_as_off(tmp_path: Path) -> None:
    plan = load(tmp_path, f"{RELEASES}[versions]\nas-shipped = false")
    assert plan.options == {CellKind.VERSIONS: ()}


def test_models_are_named_from_the_folder_of_the_plan(tmp_path: Path) -> None:
    (tmp_path / "robots").mkdir()
    (tmp_path / "robots/arm.xml").write_text(CONTACT_XML)
    plan = load(tmp_path, f'models = ["robots/arm.xml", "pile"]\n{RELEASES}')
    assert [(source.name, source.path) for source in plan.models] == [
        ("robots/arm.xml", tmp_path / "robots/arm.xml"),
        ("pile", models.shipped_folder() / "pile.xml"),
    ]


@pytest.mark.parametrize("text", ['releases = "..3.5.0"', 'releases = ["3.3.0", "3.5.0"]'])
def test_a_range_has_all_releases_between(tmp_path: Path, text: str) -> None:
    assert [spec.version for spec in load(tmp_path, text).releases] == ["3.3.0", "3.5.0"]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("models = [", "plan.toml: not TOML: "),
        (f'{RELEASES}modles = ["pile"]', "line 2: modles: no such key (did you mean models?)"),
        (f"{RELEASES}[version]", "line 2: version: no such table (did you mean versions"),
        (
            f"{RELEASES}[versions]\nseeds = 1",
            "line 3: versions.seeds: no such key (did you mean seed",
        ),
        (
            f"{RELEASES}[versions]\ntotal-steps = 1",
            "versions.total-steps: no such key here; it belongs in [c",
        ),
        (f'{RELEASES}[versions]\nmodels = ["pile"]', "it belongs before the first table"),
        (f"{RELEASES}models = 3", "models: give a list of texts"),
        (f"{RELEASES}models = []", "models: the list is empty"),
        (f'{RELEASES}models = ["pile", "pile"]', "models: pile is given twice"),
        (
            f'{RELEASES}models = [\n  "pile",\n  "humanod",\n]',
            "line 4: models: no model 'humanod' (did you mean humanoid?)",
        ),
        (f'{RELEASES}models = ["a/b.xml"]', "models: no such file: a/b.xml"),
        (f'{RELEASES}models = ["a\\u200b.xml"]', "a name that cannot be printed"),
        (f'{RELEASES}paths = ["rolout"]', "paths: no path 'rolout' (did you mean rollout"),
        (f'{RELEASES}paths = ["mjx"]', "paths: path mjx compiles first"),
        (f'{RELEASES}paths = ["mine:Path"]', "a path of your own is not on other machines"),
        (f'{RELEASES}metrics = ["tmie"]', "metrics: no metric tmie (did you mean time?)"),
        (
            f'{RELEASES}paths = ["rollout"]\nmetrics = ["p99"]',
            "line 2: paths: all metrics but time are of python_loop only",
        ),
        (f'{RELEASES}machines = [" "]', "machines: ' ' is not a label"),
        ("", "releases: [versions] needs 2 or more"),
        (
            'releases = ["3.3.0"]',
            'line 1: releases: [versions] needs 2 or more, such as releases = ["',
        ),
        ("[instructions]", "releases: [instructions] needs 1 or more"),
        ('releases = ["3.3.0", "3.99.0"]', "line 1: releases: there is no MuJoCo 3.99.0"),
        ('releases = ["3.3.0", "3.3"]', "releases: 3.3: MuJoCo 3.3.0 is given twice"),
        (
            'releases = ["3.3.0", "newst"]',
            "releases: 'newst' is not a release (did you mean newest",
        ),
        ('releases = ["1.0.0", "3.3.0"]', "releases: MuJoCo 1.0.0 is too old"),
        ('releases = ["3.5.0..3.3.0"]', "releases: 3.5.0..3.3.0: there is no release between them"),
        (
            f'{RELEASES}[versions]\nagainst = "3.9.0"',
            'versions.against: give "first", "previous" or',
        ),
        (
            f'{RELEASES}[versions]\nnstep = "many"',
            "line 3: versions.nstep: 'many' is not a whole number",
        ),
        (f"{RELEASES}[versions]\nnstep = 0", "versions.nstep: '0' is not a whole number"),
        (
            f'{RELEASES}[versions]\nmin-effect = "tea"',
            "versions.min-effect: 'tea' is not a percent",
        ),
        (
            f"{RELEASES}[versions]\nnstep = 10\nhold = 3",
            "versions: --nstep 10 is not a multiple of",
        ),
        (f"{RELEASES}[versions]\nas-shipped = 1", "versions.as-shipped: give true or false"),
        (f"{RELEASES}[versions]\nnstep = true", "versions.nstep: give a number or a text"),
        (
            f"{RELEASES}[versions]\nseed = 1979-05-27",
            "versions.seed: give a number, a text, or a l",
        ),
        ('[compare]\npaths = ["rolout"]', "compare.paths: no path 'rolout' (did you mean rollout"),
        ('[compare]\npaths = "a:B"', "compare.paths: a:B: a path of your own is not on other mach"),
        ('[compare]\nreturns = "all"', "compare.returns: 'all' is not one of 'final'"),
        ("[compare]\n[nodes]\ntries = 0", "line 3: nodes.tries: give a whole number from 1 to 100"),
        ("[compare]\n[nodes]\nmin-cores = 101", "nodes.min-cores: give a number from 0 to 100"),
        ('[compare]\n[nodes]\npatience = "long"', "nodes.patience: give a number from 0 to 86400"),
        ("nodes = 3", "nodes: no such key"),
        ("[[versions]]", "versions: no such key"),
    ],
)
def test_what_is_wrong_is_one_line_with_its_place(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(InputError) as caught:
        load(tmp_path, text)
    line = str(caught.value)
    assert message in line
    assert line.startswith(str(tmp_path / "plan.toml"))
    assert "\n" not in line


def test_a_file_that_is_no_plan_is_refused(tmp_path: Path) -> None:
    (tmp_path / "bytes.toml").write_bytes(b"\xff\xfe")
    for name, message in (
        ("none.toml", "cannot read"),
        ("bytes.toml", "not TOML"),
        (".", "folder"),
    ):
        with pytest.raises(InputError, match=message):
            plans.load(tmp_path / name, check_command, lambda: VERSIONS)


def test_releases_that_nobody_knows_are_left_to_the_nodes(tmp_path: Path) -> None:
    file = plan_file(tmp_path, 'releases = ["3.3.0", "9.9.0"]')
    plan = plans.load(file, check_command, frozenset)
    assert [spec.version for spec in plan.releases] == ["3.3.0", "9.9.0"]
    with pytest.raises(InputError, match="which releases there are is not known here; name each"):
        plans.load(plan_file(tmp_path, 'releases = "3.3.0.."'), check_command, frozenset)


def test_a_wheel_is_refused(tmp_path: Path) -> None:
    text = f'releases = ["3.3.0", "{tmp_path}/mujoco-4.1.0-py3-none-any.whl"]'
    with pytest.raises(InputError, match="releases: "):
        load(tmp_path, text)


def test_the_plan_of_the_guide_is_a_plan(tmp_path: Path) -> None:
    guide = (ROOT / "docs/guides/machines.md").read_text()
    (tmp_path / "robots").mkdir()
    (tmp_path / "robots/arm.xml").write_text(CONTACT_XML)
    (example,) = re.findall(r"```toml\n(.*?)```", guide, flags=re.DOTALL)
    assert load(tmp_path, example).pairs


def test_the_guide_has_every_key_of_a_plan() -> None:
    guide = (ROOT / "docs/guides/machines.md").read_text()
    keys = {key for keys in plans._known_keys().values() for key in keys}
    assert {key for key in keys if f"`{key}`" not in guide} == set()


@given(st.text() | st.from_regex(r"(models|releases|paths)? ?= ?[\[\"a-z0-9.]*\n\[nodes\]"))
def test_any_text_is_a_plan_or_an_input_error(text: str) -> None:
    import tempfile

    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "plan.toml"
        file.write_text(text, encoding="utf-8", errors="replace")
        try:
            plans.load(file, check_command, lambda: VERSIONS)
        except InputError as error:
            assert "\n" not in str(error)
