"""Which scope a name belongs to, and what may bind it again."""

import ast

import pytest

from mjbench.commands.lint.name_bindings import NameBindings, bound_by


def bindings(text: str) -> tuple[ast.Module, NameBindings]:
    tree = ast.parse(text)
    parents = {child: node for node in ast.walk(tree) for child in ast.iter_child_nodes(node)}
    return tree, NameBindings(tree, parents)


@pytest.mark.parametrize(
    ("imports", "name", "origin"),
    [
        ("import mujoco", "mujoco.mj_step", "mujoco.mj_step"),
        ("import mujoco.viewer", "mujoco.mj_step", "mujoco.mj_step"),
        ("import mujoco as mj\ndef f():\n  import mujoco as mj", "mj.MjData", "mujoco.MjData"),
        ("import a.b as c", "c.d", "a.b.d"),
        ("from mujoco import mj_step as s", "s", "mujoco.mj_step"),
        ("from .mujoco import mj_step", "mj_step", ""),
        ("from . import mujoco", "mujoco.mj_step", ""),
        ("from mujoco import *", "mj_step", ""),
        ("import mujoco\ndef f(mujoco): pass", "mujoco.mj_step", ""),
        ("import mujoco\nimport jax as mujoco", "mujoco.mj_step", ""),
        ("import mujoco\ndef f():\n  global mujoco", "mujoco.mj_step", ""),
        ("mujoco = 1", "mujoco.mj_step", ""),
        ("", "", ""),
    ],
)
def test_the_origin_of_a_name_is_what_alone_is_imported_as_it(
    imports: str, name: str, origin: str
) -> None:
    _, names = bindings(imports)
    assert names.origin(name) == origin


def test_identifiers_are_all_names_and_no_strings() -> None:
    text = "def f(a, *b, c=1) -> d:\n  global e\n  import g.h as i\n  j.k(l=m, n='o')  # p\n"
    _, names = bindings(text)
    assert names.identifiers == set("abcdefghijklmn")


def test_a_node_that_is_read_binds_nothing() -> None:
    assert bound_by(ast.Name("x", ast.Load())) == ()
    assert bound_by(ast.Constant("x")) == ()
