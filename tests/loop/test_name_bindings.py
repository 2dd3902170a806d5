"""Which scope a name belongs to, and what may bind it again."""

import ast

import pytest

from mjbench.loop.name_bindings import NameBindings, bound_by


def bindings(text: str) -> tuple[ast.Module, NameBindings]:
    tree = ast.parse(text)
    parents = {child: node for node in ast.walk(tree) for child in ast.iter_child_nodes(node)}
    return tree, NameBindings(tree, parents)


def loop_in(tree: ast.Module) -> ast.For:
    return next(node for node in ast.walk(tree) if isinstance(node, ast.For))


@pytest.mark.parametrize(
    "statement",
    [
        "x = 1",
        "x += 1",
        "x: int",
        "(x := 1)",
        "del x",
        "[y, *x] = z",
        "for x in y: pass",
        "with y as (z, x): pass",
        "import a.b as x",
        "import x.y",
        "from a import b as x",
        "from a import *",
        "def x(): pass",
        "class x: pass",
        "try: pass\n  except E as x: pass",
        "match y:\n    case [1, *x]: pass",
        "match y:\n    case {'k': 1, **x}: pass",
        "match y:\n    case C(a=1) as x: pass",
        "[x for x in y]",
        "lambda x: x",
    ],
)
def test_every_way_to_bind_a_name_is_seen_in_a_loop(statement: str) -> None:
    tree, names = bindings(f"x = 0\nfor i in j:\n  {statement}\n")
    assert names.rebinding("x", loop_in(tree)) == "the loop binds x again"
    assert "*" in statement or names.rebinding("unknown", loop_in(tree)).startswith("where unknown")


def test_a_name_that_nothing_binds_again_stays() -> None:
    tree, names = bindings("x = 0\nx = y.x = 1\nfor i in x:\n  x.a = f(x=1).x[x] = x\nx = 2\n")
    assert names.rebinding("x", loop_in(tree)) == ""


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("x = 0\ndef f():\n  for i in j: x\n", ""),
        ("import x\ndef f():\n  for i in j: x\n", ""),
        ("x = 0\nx = 1\ndef f():\n  for i in j: x\n", "x belongs to another scope"),
        ("while 1: x = 0\ndef f():\n  for i in j: x\n", "x belongs to another scope"),
        ("from a import *\nx = 0\ndef f():\n  for i in j: x\n", "x belongs to another scope"),
        ("x = 0\ndef f(x):\n  x = 1\n  for i in j: x\n", ""),
        ("x = 0\ndef g():\n  global x\ndef f():\n  for i in j: x\n", "a global or nonlocal"),
        ("x = 0\nvars()\ndef f():\n  for i in j: x\n", "exec, setattr"),
        ("vars()\ndef f(x):\n  for i in j: x\n", "exec, setattr"),
        ("class C:\n  x = 0\n  def f(self):\n    for i in j: x\n", "where x gets its value"),
        ("def f(x):\n  def g():\n    for i in j: x\n", ""),
        ("def f(x):\n  def g(y=(x := 1)):\n    for i in j: x\n", ""),
        ("def f(x):\n  x = 1\n  def g():\n    for i in j: x\n", "x belongs to another scope"),
    ],
)
def test_a_name_of_another_scope_stays_if_it_is_bound_once(text: str, reason: str) -> None:
    tree, names = bindings(text)
    actual = names.rebinding("x", loop_in(tree))
    assert actual.startswith(reason)
    assert bool(actual) == bool(reason)


@pytest.mark.parametrize(
    ("before", "is_bound"),
    [
        ("x = 0", True),
        ("x, y = 0, None", False),
        ("x = None", False),
        ("x = 0 if y else None", False),
        ("x = y or None", False),
        ("if y: x = 0", False),
        ("try: x = 0\nexcept E: pass", False),
        ("for x in y: pass", False),
        ("with y as x: pass", True),
        ("import x", True),
        ("x = load(y or 0)", True),
    ],
)
def test_a_name_has_a_value_where_no_branch_passes_by(before: str, is_bound: bool) -> None:
    tree, names = bindings(f"if z:\n pass\n{before}\nwhile x: y = x\n")
    loop = next(node for node in ast.walk(tree) if isinstance(node, ast.While))
    assert names.is_certainly_bound("x", loop) == is_bound
    inside, names = bindings("if z:\n  x = 0\n  while x: y = x\n")
    loop = next(node for node in ast.walk(inside) if isinstance(node, ast.While))
    assert names.is_certainly_bound("x", loop)
    assert not names.is_certainly_bound("unknown", loop)


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
