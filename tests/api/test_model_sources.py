"""From a name, a path or a model of this process to what child processes load."""

from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from example_models import CONTACT_XML

from mjbench.api import model_sources
from mjbench.errors import InputError, MachineError
from mjbench.simulation import models


def test_names_and_paths_are_those_of_the_command_line(contact_file: str) -> None:
    given = ["cartpole", contact_file, Path(contact_file), "cartpole"]
    with model_sources.sources(given) as sources:
        assert sources == [models.resolve("cartpole"), models.resolve(contact_file)]


def test_a_compiled_model_is_loaded_as_it_is_now(model: Any) -> None:
    changed = mujoco.MjModel.from_xml_string(CONTACT_XML)
    changed.opt.timestep = 0.0005
    changed.body_mass[:] *= 2
    with model_sources.sources([changed]) as (source,):
        loaded = models.load(source)
        file = source.path
    assert loaded.opt.timestep == 0.0005
    np.testing.assert_array_equal(loaded.body_mass, changed.body_mass)
    assert not file.exists()


def test_a_specification_is_compiled_and_stays_as_it_is() -> None:
    spec = mujoco.MjSpec.from_string(CONTACT_XML)
    spec.modelname = "box"
    before = spec.to_xml() if spec.compile() else ""
    with model_sources.sources([spec]) as (source,):
        assert source.name == "box"
        assert models.load(source).nv == spec.compile().nv
    assert spec.to_xml() == before


def test_models_of_the_same_name_get_numbers(model: Any) -> None:
    spec = mujoco.MjSpec.from_string(CONTACT_XML)
    spec.modelname = "cartpole"
    with model_sources.sources([spec, "cartpole", spec.compile()]) as sources:
        names = [source.name for source in sources]
    assert names == ["cartpole (2)", "cartpole", "cartpole (3)"]


def test_the_name_of_a_model_cannot_forge_a_line() -> None:
    spec = mujoco.MjSpec.from_string(CONTACT_XML)
    spec.modelname = "a\nb\x1b[31m" + 300 * "c"
    with model_sources.sources([spec]) as (source,):
        assert source.name.isprintable()
        assert len(source.name) <= 100


@pytest.mark.parametrize("given", [None, 3, b"cartpole", object()])
def test_what_is_no_model_is_refused(given: Any) -> None:
    with pytest.raises(InputError, match="a model is one of"), model_sources.sources([given]):
        pass


def test_a_specification_that_does_not_compile_is_refused() -> None:
    spec = mujoco.MjSpec()
    spec.worldbody.add_body().add_joint()
    with pytest.raises(InputError, match=r"cannot compile the MjSpec: .*mass"):
        model_sources.sources([spec]).__enter__()


def test_other_releases_need_a_name_or_a_path(model: Any) -> None:
    assert model_sources.named("cartpole") == models.resolve("cartpole")
    with pytest.raises(InputError, match="other releases cannot load"):
        model_sources.named(model)
    with pytest.raises(InputError, match="no model 'cartpol'"):
        model_sources.named("cartpol")


def test_a_model_that_a_full_disk_cuts_short_is_an_error_of_the_machine(
    model: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    save = mujoco.mj_saveModel

    def cut_short(model: mujoco.MjModel, file: str, buffer: None = None) -> None:
        save(model, file, buffer)
        Path(file).write_bytes(Path(file).read_bytes()[:-1])

    monkeypatch.setattr(mujoco, "mj_saveModel", cut_short)
    with pytest.raises(MachineError, match="is the disk full"), model_sources.sources([model]):
        pytest.fail("it is not complete")
