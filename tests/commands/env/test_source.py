"""Names of environments."""

from pathlib import Path

import pytest

from mjbench.commands.env.source import Origin, resolve
from mjbench.errors import InputError

HERE = Path("/somewhere")


@pytest.mark.parametrize(
    ("name", "origin", "module", "attribute"),
    [
        ("Humanoid-v5", Origin.GYMNASIUM, "", "Humanoid-v5"),
        ("my_package:Robot-v0", Origin.GYMNASIUM, "", "my_package:Robot-v0"),
        ("dm_control:humanoid-walk", Origin.DM_CONTROL, "humanoid", "walk"),
        ("dm_control:ball_in_cup-catch", Origin.DM_CONTROL, "ball_in_cup", "catch"),
        ("my_env:make", Origin.FACTORY, "my_env", "make"),
        ("a.b.c:Tasks.reach", Origin.FACTORY, "a.b.c", "Tasks.reach"),
    ],
)
def test_a_name_stands_for_what_makes_the_environment(
    name: str, origin: Origin, module: str, attribute: str
) -> None:
    source = resolve(name, HERE)
    assert (source.origin, source.module, source.attribute) == (origin, module, attribute)
    assert (source.name, source.folder) == (name, HERE)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("", "give a Gymnasium id"),
        ("two words", "give a Gymnasium id"),
        ("tab\tinside", "give a Gymnasium id"),
        ("my env:make", "give a Gymnasium id"),
        ("my_env:", "is no environment"),
        ("my_env:make()", "is no environment"),
        ("dm_control:humanoid", "give dm_control:DOMAIN-TASK"),
        ("dm_control:-walk", "give dm_control:DOMAIN-TASK"),
        ("robot.xml", "`mjbench profile` takes models"),
        ("train.py", "give MODULE:FACTORY"),
    ],
)
def test_another_name_is_refused_with_what_to_give(name: str, message: str) -> None:
    with pytest.raises(InputError, match=r"no environment|give") as refused:
        resolve(name, HERE)
    assert message in str(refused.value)
    assert "\n" not in str(refused.value)
    assert str(refused.value).isprintable()
