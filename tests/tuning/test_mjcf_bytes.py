"""Whatever the encoding, line ends and layout of a file, only what settings change changes."""

import difflib
import itertools
import re
from collections.abc import Sequence

import mujoco
import pytest
from example_edits import ALL, CG, NO_ISLAND, STEP, checked_edit, disables

from mjbench.simulation import models
from mjbench.tuning.mjcf_edit import edited
from mjbench.tuning.settings import Edit, Part

MANNERS = """<?xml version='1.0' {encoding}?>
<!DOCTYPE mujoco [ <!ENTITY half "0.5"> <!-- option --> ]>
<!-- before -->
<mujoco model = 'm&amp;m' >
\t<option   solver='PGS'\ttimestep = "0.001"
\t\tcone="elliptic" />   <!-- behind -->

\t<compiler angle="radian"></compiler><size memory='1M'/>
\t<custom><text name="t" data="caf\xe9 &gt; 'x'"/></custom>
\t<option><flag energy='disable' /></option>
  \t
</mujoco >
<!-- after --><?pi x?>
"""


@pytest.mark.parametrize("newline", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize(
    ("codec", "mark", "declared"),
    [
        ("utf-8", b"", ""),
        ("utf-8", b"\xef\xbb\xbf", "encoding='UTF-8'"),
        ("latin-1", b"", "encoding='ISO-8859-1'"),
        ("cp1252", b"", "encoding='windows-1252'"),
        ("latin-1", b"", "encoding='klingon'"),
    ],
)
def test_all_other_bytes_stay(codec: str, mark: bytes, declared: str, newline: str) -> None:
    text = MANNERS.format(encoding=declared).replace("\n", newline)
    changed = edited(mark + text.encode(codec), ALL)
    assert edited(changed, ALL) == changed
    assert changed.startswith(mark)
    contact = '\t<contact>\n\t\t<exclude body1="a" body2="b"/>\n\t</contact>'
    expected = (
        text.replace("'PGS'", "'CG'")
        .replace('"0.001"', '"0.003"')
        .replace("energy='disable'", "energy='enable' island='disable'")
        .replace('angle="radian"', 'angle="radian" fusestatic="true"')
        .replace(
            f"</option>{newline}  \t",
            f"</option>\n{contact}\n  \t".replace("\n", newline),
        )
    )
    assert changed[len(mark) :].decode(codec) == expected


def test_names_are_utf_8_whatever_a_file_declares_as_mujoco_reads_it() -> None:
    text = "<?xml version='1.0' encoding='ISO-8859-1'?><mujoco><!-- \xe9 --></mujoco>"
    edit = Edit(Part.EXCLUDE, "\xe9", "\u03b1")
    changed = edited(text.encode("latin-1"), [edit])
    assert '<exclude body1="\xe9" body2="\u03b1"/>'.encode() in changed
    assert edited(changed, [edit]) == changed


@pytest.mark.parametrize("name", models.shipped())
@pytest.mark.parametrize("edits", [*((edit,) for edit in ALL[:-1]), ALL[:-1]], ids=str)
def test_shipped_models_differ_only_in_what_was_added(name: str, edits: tuple[Edit, ...]) -> None:
    path = models.resolve(name).path
    text = path.read_text()
    changed = checked_edit(text, *edits)
    assert _reverted(text, changed, edits) == text
    model = mujoco.MjSpec.from_string(changed).compile()
    assert disables(model, "island") == (NO_ISLAND in edits)
    assert (model.opt.timestep == 0.003) == (STEP in edits)
    if CG in edits:
        assert model.opt.solver == mujoco.mjtSolver.mjSOL_CG


def _reverted(text: str, changed: str, edits: tuple[Edit, ...]) -> str:
    """Return the original: only values of edits are replaced, and only their markup is added."""
    before, after = (re.findall(r"\s+|[^\s\"<>=]+|.", each) for each in (text, changed))
    first = _same(before, after)
    last = _same(before[:first:-1], after[:first:-1])
    head, tail = before[:first], before[len(before) - last :]
    before, after = before[first : len(before) - last], after[first : len(after) - last]
    parts = []
    allowed = {"option", "flag", "compiler", "/option", "/flag", "/", "<", ">", "=", '"'}
    allowed |= {part for edit in edits for part in (edit.name, edit.value)}
    matcher = difflib.SequenceMatcher(None, before, after, autojunk=False)
    for kind, start, end, new_start, new_end in matcher.get_opcodes():
        added = after[new_start:new_end]
        if kind != "equal":
            assert all(part.isspace() or part in allowed for part in added), added
            assert len(before[start:end]) <= 1, before[start:end]
        parts += before[start:end]
    return "".join([*head, *parts, *tail])


def _same(one: Sequence[str], other: Sequence[str]) -> int:
    """Return how many parts are the same at the begin: a whole file takes long to compare."""
    pairs = zip(one, other, strict=False)
    return sum(1 for _ in itertools.takewhile(lambda pair: pair[0] == pair[1], pairs))


def test_a_large_file_is_edited_at_both_ends() -> None:
    geoms = '    <geom type="sphere" size="0.1" pos="0 0 1"/>  <!-- -- -->\n' * 90_000
    start = '<mujoco>\n  <option solver="PGS"/>\n  <worldbody>\n'
    text = f"{start}{geoms}  </worldbody>\n</mujoco>\n"
    assert len(text) > 5_000_000
    pairs = [Edit(Part.EXCLUDE, f"a{number}", "b") for number in range(2_000)]
    changed = edited(text.encode(), [CG, NO_ISLAND, *pairs]).decode()
    flag = '<option solver="CG">\n    <flag island="disable"/>\n  </option>'
    excludes = "".join(f'\n    <exclude body1="{pair.name}" body2="b"/>' for pair in pairs)
    head = start.replace('<option solver="PGS"/>', flag)
    tail = f"  </worldbody>\n  <contact>{excludes}\n  </contact>\n</mujoco>\n"
    assert changed == f"{head}{geoms}{tail}"
