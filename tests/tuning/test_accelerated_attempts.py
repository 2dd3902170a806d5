"""Settings of an engine that compiles, tried in children: errors from C, failures, MJX itself."""

import os
from types import SimpleNamespace

import pytest
from commands import PYTHONPATH
from pretender import available

from mjbench.errors import MachineError, UnavailableError
from mjbench.host import isolate
from mjbench.simulation import models
from mjbench.simulation.reference_run import Peaks
from mjbench.simulation.starts import StartPlan
from mjbench.status import Status
from mjbench.tuning import knob_values, measurements
from mjbench.tuning.accelerated_attempts import EngineMeasurements
from mjbench.tuning.reference import TrialPlan
from mjbench.tuning.settings import Setting, label, option

# With so little time for the reference, few runs from few draws.
PLAN = TrialPlan(0, StartPlan(), ncontrol=4, horizon_ncontrol=4, reference_s=0.01)
# C under another name; it crashes, rejects or overflows with some settings.
ENGINES = """
import os
from mjbench.paths.mjx import Mjx
from mjbench.paths.warp_buffers import OverflowedError
from mjbench.tuning import accelerated_attempts
from pretender import Pretender

class Faulty(Pretender):
    name = "faulty:Faulty"
    def default_buffer_sizes(self, model):
        return {"nconmax": 4, "njmax": 400}
    def compile(self, work, options, peaks):
        if work.model.opt.iterations == 2:
            os._exit(3)
        if work.model.opt.iterations == 4:
            raise NotImplementedError("four")
        if options.get("nconmax", 100) < 8:
            raise OverflowedError("overflowed")
        return super().compile(work, options, peaks)

class Picky(Pretender):
    name = "faulty:Picky"
    def compile(self, work, options, peaks):
        raise NotImplementedError("no contact")

class Needy(Pretender):
    name = "faulty:Needy"
    packages = ("a_package_that_nobody_has",)

class Divergent(Pretender):
    name = "faulty:Divergent"
    def __init__(self):
        super().__init__("nan")

class BrieflyTimed(Mjx):
    name = "faulty:BrieflyTimed"
    def compile(self, work, options, peaks):
        accelerated_attempts.TIMED_S = 0.0
        return super().compile(work, options, peaks)
"""


@pytest.fixture(scope="module")
def on(tmp_path_factory):
    """Return measurements of an engine on a model; C's runs of a model are those of all engines."""
    folder = tmp_path_factory.mktemp("engines")
    (folder / "faulty.py").write_text(ENGINES)

    def measurements(engine, model="cube_table", nbatch=12, limit_s=60.0):
        pool = SimpleNamespace(new_file=lambda suffix: folder / f"{model}{suffix}")
        return EngineMeasurements(pool, models.resolve(model), engine, nbatch, limit_s)

    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(folder))
        patch.setenv("PYTHONPATH", f"{folder}{os.pathsep}{PYTHONPATH}")
        yield measurements


@pytest.fixture(scope="module")
def cube_table(on):
    """Return the facts of C's runs of the cube on a table."""
    return on("faulty:Faulty").baseline(PLAN)


@pytest.fixture(scope="module")
def cartpole(on):
    """Return the facts of C's runs of the cart-pole."""
    return on("pretender:Pretender32", model="cartpole").baseline(PLAN)


def tried(measurements, *settings, **keywords):
    attempts = []
    present = measurements.launch([(each,) for each in settings], attempts.append, **keywords)
    return present, {label(each.settings): each for each in attempts}


@pytest.fixture(scope="module")
def launched(on, cube_table):
    """Return the present program, and the attempts of a launch in which a setting crashes."""
    numbers = (option("iterations", number) for number in ("4", "2", "99", "1"))
    return tried(on("faulty:Faulty"), *numbers, option("solver", "CG"))


def test_c_itself_transfers_without_error_and_fewer_iterations_do_not(cube_table, launched):
    assert cube_table.rounding.share == 0.0  # this engine computes in float64
    assert cube_table.horizon_ncontrol == 4
    present, attempts = launched
    assert present.error is not None and present.error.share == 0.0
    assert attempts["iterations=99"].error.share == 0.0
    assert attempts["iterations=1"].error.share > 1e-6
    assert attempts["solver=CG"].error.share > 0.0
    assert attempts["solver=CG"].time_ratio is not None


def test_the_many_steps_of_c_have_more_time_than_a_child_that_reports_nothing(on, monkeypatch):
    limits = []
    monkeypatch.setattr(isolate, "call", lambda *_, limit_s, **__: limits.append(limit_s))
    for limit_s in (60.0, 900.0):
        on("pretender:Pretender", limit_s=limit_s).baseline(PLAN)
    assert limits == [measurements.RUNS_SILENCE_S, 900.0]


def test_a_setting_that_crashes_or_is_rejected_is_one_row_and_the_others_go_on(launched):
    _, attempts = launched
    assert attempts["iterations=2"].status == Status.CRASHED
    assert "while trying iterations=2" in attempts["iterations=2"].detail
    assert attempts["iterations=4"].status == Status.FAILED
    assert "four" in attempts["iterations=4"].detail
    assert attempts["iterations=99"].status == Status.OK


def test_a_buffer_that_is_too_small_fails_and_the_engine_s_own_is_replaced(on, cube_table):
    """The engine's own sizes overflow, so the present settings get room for what C needs."""
    sizes = {each.label: each.buffer_sizes for each in cube_table.settings if each.buffer_sizes}
    assert sizes == {"njmax=64": {"njmax": 64}}  # not nconmax, of which there are only 4
    small = Setting("nconmax", "nconmax=7", buffer_sizes={"nconmax": 7})
    large = Setting("nconmax", "nconmax=9", buffer_sizes={"nconmax": 9})
    _, attempts = tried(on("faulty:Faulty"), small, large, has_errors=False)
    assert attempts["nconmax=7"].detail == "overflowed"
    assert attempts["nconmax=9"].status == Status.OK
    assert attempts["nconmax=9"].error is None


def test_present_settings_that_the_engine_rejects_or_that_diverge_end_the_search(
    on, cartpole, inline
):
    with pytest.raises(UnavailableError, match=r"does not take this model: .*no contact"):
        tried(on("faulty:Picky", model="cartpole"))
    with pytest.raises(UnavailableError, match="a_package_that_nobody_has"):
        on("faulty:Needy", model="cartpole").baseline(PLAN)
    with pytest.raises(MachineError, match="diverges in 3 of 32 runs"):
        tried(on("faulty:Divergent", model="cartpole"))


def test_nothing_is_begun_after_its_time(on, cartpole, inline):
    engine = on("pretender:Pretender", model="cartpole")
    _, attempts = tried(engine, option("solver", "CG"), stop_after_s=0.0)
    assert attempts == {}


def test_mjx_transfers_within_rounding_on_the_cart_pole(on, cartpole, without_warp):
    available("mjx")
    engine = on("faulty:BrieflyTimed", model="cartpole", nbatch=16)
    present, attempts = tried(engine, option("iterations", "1"))
    (attempt,) = attempts.values()
    for program in (present, attempt.program):
        assert program.error.share < 100 * cartpole.rounding.share < 1e-3
        assert program.compile_s > 0 and program.trace_s > 0
    assert attempt.time_ratio > 0


def test_settings_to_try_are_below_the_present_ones_or_others_than_those():
    model = models.load(models.resolve("cube_table"))
    model.opt.iterations = 5
    settings = knob_values.of_batched_step(model, Peaks(8, 32), {"nconmax": 48, "njmax": 60})
    texts = [each.label for each in settings]
    assert {"iterations=4", "iterations=3", "solver=CG", "nconmax=16"} <= set(texts)
    assert not {"iterations=6", "iterations=8", "solver=Newton", "njmax=64"} & set(texts)
    assert {"jacobian=dense", "jacobian=sparse"} <= set(texts)
    assert texts[0].startswith("iterations") and texts[1].startswith("ls_iterations")
    model.opt.jacobian = 0
    without = knob_values.of_batched_step(model, Peaks(8, 32), {})
    assert not {"jacobian=dense", "nconmax=16"} & {each.label for each in without}
