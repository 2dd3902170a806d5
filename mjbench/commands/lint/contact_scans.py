"""Loops over contacts that take them one by one, where MuJoCo has arrays of all of them."""

import ast
import itertools
from collections.abc import Iterator

from mjbench.commands.lint.repeats import following, in_steps
from mjbench.commands.lint.rule import Match, rule
from mjbench.commands.lint.script_syntax import (
    COMPREHENSIONS,
    FUNCTIONS,
    attributes_in,
    is_call,
    names_in,
    nodes_inside,
)
from mjbench.commands.lint.stepping_script import SteppingScript

_OF_CONTACTS = {"contact", "geom1", "geom2"}
# How many there are differs from step to step.
COUNTS = {"ncon", "nefc"}
_NAMES = ("mj_id2name", "id2name", "geom_id2name", "body_id2name")


@rule(
    "MJB019",
    "contacts are taken one by one in every step: data.contact.geom, .dist and .pos are arrays of"
    " all contacts",
)
def contact_scans(script: SteppingScript) -> Iterator[Match]:
    """Yield loops in every step that iterate over contacts, or look up a name for each.

    `for contact in data.contact` ends with an exception in C++, which took 0.1 to 0.2 ms in the
    releases that were tried (3.2.7, 3.3.7 and 4.0.0), even without any contact. A name is text that
    is created each time. `data.contact.geom` (a row of two ids for each contact), `.dist`, `.pos`,
    `.frame` and `.efc_address` are arrays of all contacts.

        for i in range(data.ncon):
            contact = data.contact[i]
            if model.geom(contact.geom1).name == "tip":
                mujoco.mj_contactForce(model, data, i, force)
                total += force[0]

        tip = model.geom("tip").id                        # instead, before the loop
        touching = data.contact.geom[:, 0] == tip         # in the loop
        rows = data.contact.efc_address[touching]
        total += data.efc_force[rows].sum()

    `efc_force` at `efc_address` is the normal force of a contact with an elliptic cone, or without
    friction; with a pyramidal cone, the normal force is the sum of the contact's `2 * (dim - 1)`
    rows from there on. A contact without rows has the address -1. Or let a touch or a contact
    sensor compute it.

    There is no finding for `data.contact[i]` without names, which is as fast for a few contacts,
    and where the loop runs under a condition other than on the number of contacts.

    Results: none change, up to the order of sums.
    """
    scans = [n for n in script.nodes if isinstance(n, ast.For | COMPREHENSIONS)]
    loops = [*script.loops, *script.environment_loops]
    for loop, each in in_steps(script, scans, loops, or_methods=True):
        message = _message(script, loop)
        if message and not _is_conditional(script, loop):
            yield Match(loop, message=message, loop=each.calling_loop)


def _message(script: SteppingScript, loop: ast.For | COMPREHENSIONS) -> str:
    """Return what to do, by what a loop asks of each contact; nothing for other loops."""
    iterable = loop.iter if isinstance(loop, ast.For) else loop.generators[0].iter
    if is_call(iterable, "enumerate", "range") and iterable.args:
        iterable = iterable.args[-1 if is_call(iterable, "range") else 0]
    iterable = script.resolved(iterable)
    if isinstance(iterable, ast.Subscript) and isinstance(iterable.slice, ast.Slice):
        iterable = iterable.value
    if not isinstance(iterable, ast.Attribute) or not script.is_data(iterable.value):
        return ""
    data = ast.unparse(iterable.value)
    arrays = f"{data}.contact.geom, .dist and .pos are arrays of all contacts"
    if iterable.attr == "contact":
        return (
            f"iterating over {data}.contact ends with an exception, which takes about 0.1 ms:"
            f" {arrays}"
        )
    calls = [node for node in nodes_inside(loop) if isinstance(node, ast.Call)]
    has_names = any(
        is_call(call, *_NAMES) or getattr(script.parents[call], "attr", "") == "name"
        for call in calls
        if names_contact(script, call, loop)
    )
    if iterable.attr != "ncon" or not has_names:
        return ""
    has_forces = any(is_call(call, "mj_contactForce") for call in calls)
    forces = ", and efc_force at .efc_address holds forces" if has_forces else ""
    return (
        f"a name is looked up for each contact in every step: compare ids from before the loop;"
        f" {arrays}{forces}"
    )


def names_contact(script: SteppingScript, call: ast.Call, scope: ast.AST) -> bool:
    """Return whether an argument follows from contacts, which are others in each step."""
    names = following(script, scope, set(), _OF_CONTACTS)
    return any(names_in(a) & names or attributes_in(a) & _OF_CONTACTS for a in call.args)


def _is_conditional(script: SteppingScript, loop: ast.expr | ast.stmt) -> bool:
    """Return whether a loop runs under a condition other than on the number of contacts."""
    above = script.above(loop, script.step_loop_around(loop))
    around = itertools.takewhile(lambda node: not isinstance(node, FUNCTIONS), above)
    tests = (node.test for node in around if isinstance(node, ast.If | ast.IfExp))
    return any(not attributes_in(test) & COUNTS for test in tests)
