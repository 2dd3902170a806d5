"""Fields of MjOption: values that fit are set, all others are refused with what is allowed."""

import math

import mujoco
import pytest
from example_models import CONTACT_XML
from hypothesis import given, settings
from hypothesis import strategies as st

from mjbench.errors import InputError
from mjbench.simulation import model_options


def test_options_are_numbers_or_names_of_enum_values() -> None:
    model = mujoco.MjModel.from_xml_string(CONTACT_XML)
    for field, text in {
        "timestep": "0.001",
        "solver": "cg",
        "cone": "Elliptic",
        "integrator": "1",
        "iterations": "7",
        "tolerance": "0",
        "disableflags": "17",
        "enableflags": "2",
    }.items():
        model_options.set_option(model, field, text)
    assert model.opt.timestep == 0.001
    assert model.opt.solver == mujoco.mjtSolver.mjSOL_CG
    assert model.opt.cone == mujoco.mjtCone.mjCONE_ELLIPTIC
    assert model.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4
    assert model.opt.iterations == 7
    assert model.opt.tolerance == 0
    assert model.opt.disableflags == 17
    assert model.opt.enableflags == 2


@pytest.mark.parametrize(
    ("field", "text", "message"),
    [
        ("solver", "99", r"is not one of PGS \(0\), CG \(1\), NEWTON \(2\)"),
        ("solver", "quick", r"'quick' is not one of PGS"),
        ("solver", "-1", "whole number from 0"),
        ("cone", "7", "is not one of PYRAMIDAL"),
        ("integrator", "1e9", "is not one of EULER"),
        ("disableflags", str(2**30), r"not a sum of 1 \(CONSTRAINT\), 2 \(EQUALITY\)"),
    ],
)
def test_values_that_this_release_lacks_are_refused_with_those_it_has(
    field: str, text: str, message: str
) -> None:
    model = mujoco.MjModel.from_xml_string(CONTACT_XML)
    before = float(getattr(model.opt, field))
    with pytest.raises(InputError, match=message):
        model_options.set_option(model, field, text)
    assert getattr(model.opt, field) == before


@pytest.mark.parametrize(
    ("field", "text", "message"),
    [
        ("iterations", "many", "'many' is not a whole number from 0 to 2147483647"),
        ("iterations", "-5", "whole number from 0"),
        ("iterations", "2.5", "whole number from 0"),
        ("iterations", "1e400", "whole number from 0"),
        ("tolerance", "nan", "not a number from 0"),
        ("tolerance", "-1e-8", "not a number from 0"),
        ("timestep", "0", "not a number from 1e-15"),
        ("timestep", "-1", "not a number from 1e-15"),
        ("timestep", "nan", "not a number from 1e-15"),
        ("timestep", "inf", "not a number from 1e-15"),
        ("impratio", "0", "not a number from 1e-15"),
        ("density", "-1", "not a number from 0"),
        ("disableflags", "-1", "whole number from 0"),
        ("gravity", "0", "no option 'gravity'"),
        ("__class__", "0", "no option"),
    ],
)
def test_what_no_release_can_have_is_refused_without_one(
    field: str, text: str, message: str
) -> None:
    with pytest.raises(InputError, match=message):
        model_options.check(field, text)


@settings(deadline=None)
@given(
    field=st.sampled_from(model_options.FIELDS),
    text=st.one_of(st.text(max_size=8), st.floats().map(str), st.integers().map(str)),
)
def test_any_text_is_set_or_bad_input(field: str, text: str) -> None:
    model = _MODEL
    try:
        model_options.set_option(model, field, text)
    except InputError as error:
        assert "\n" not in str(error)
    assert math.isfinite(getattr(model.opt, field))
    assert getattr(model.opt, field) >= 0


_MODEL = mujoco.MjModel.from_xml_string(CONTACT_XML)
