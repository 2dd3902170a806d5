"""The knobs of a model: what it has no use for is not offered, and what is offered applies."""

from collections.abc import Iterable
from dataclasses import replace
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest
from tuning_models import rods

from mjbench.commands.profile.step_parts import Stage
from mjbench.commands.tune import knob_values, knobs, usual_regime
from mjbench.commands.tune import model_features as features
from mjbench.commands.tune.pair_watch import IdlePair
from mjbench.commands.tune.settings import NO_CHANGE, Edit, LoopChange, Part, Setting
from mjbench.commands.tune.usual_regime import ObservedModel, Usage, observe_model
from mjbench.errors import InputError
from mjbench.simulation import compat, model_options, models

ARM = "<body><joint damping='.1' range='-1 1' limited='true'/><geom size='.1'/></body>"


def seen(xml: str, **values: object) -> ObservedModel:
    """Return what might be seen of a model, which is not stepped."""
    usual = ObservedModel(
        mujoco.MjModel.from_xml_string(xml),
        is_mjcf=True,
        simulated_s=20.0,
        nposes=1000,
        solver=Usage(2, 9),
        line_search=Usage(2, 5),
        max_contacts=3,
        max_constraints=12,
    )
    return replace(usual, **values)  # type: ignore[arg-type]


def model_xml(option: str = "", bodies: str = ARM, more: str = "") -> str:
    return (
        f"<mujoco><option {option}><flag/></option><worldbody>{bodies}</worldbody>{more}</mujoco>"
    )


def flagged(flag: str, **values: object) -> ObservedModel:
    return seen(model_xml().replace("<flag/>", f"<flag {flag}/>"), **values)


def offered(observed: ObservedModel, knob: str) -> list[str]:
    return [setting.label for setting in knobs.settings(observed).get(knob, ())]


def apply(spec: mujoco.MjSpec, settings: Iterable[Setting]) -> mujoco.MjModel:
    """Return the model of a spec with the edits of some settings."""
    model_edits = []
    for edit in (edit for setting in settings for edit in setting.edits):
        if edit.part == Part.EXCLUDE:
            exclude = spec.add_exclude()
            exclude.bodyname1, exclude.bodyname2 = edit.name, edit.value
        elif edit.part == Part.TENDON:
            spec.delete(spec.tendon(edit.name))
        elif edit.part == Part.MESHES:
            for mesh in spec.meshes:
                setattr(mesh, edit.name, int(edit.value))
        elif edit.part == Part.COMPILER:
            assert edit.value in ("true", "false")
            setattr(spec.compiler, edit.name, edit.value == "true")
        else:
            model_edits.append(edit)
    model = spec.compile()
    for edit in model_edits:
        if edit.part == Part.FLAG:
            before = compat.flag_enabled(model, edit.name)
            assert before is (edit.value == "disable")
            model_options.set_flag(model.opt, edit.name, edit.value)
        else:
            before = getattr(model.opt, edit.name)
            model_options.set_option(model, edit.name, edit.value)
            assert getattr(model.opt, edit.name) != before
    return model


def test_knobs_have_names_of_their_own_and_stages_that_exist() -> None:
    names = [knob.name for knob in knobs.KNOBS]
    assert len(set(names)) == len(names)
    for knob in knobs.KNOBS:
        assert set(knob.stages) <= set(Stage)
        assert knob.changes.endswith(".")
        assert knob.since.count(".") == 2


@pytest.fixture
def brief(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(usual_regime, "OBSERVED_S", 0.5)
    monkeypatch.setattr(usual_regime, "NPOSE", 100)


@pytest.mark.parametrize("name", models.shipped())
def test_every_setting_of_a_shipped_model_applies(name: str, brief: None) -> None:
    source = models.resolve(name)
    settings = knobs.settings(usual_regime.observe_model(models.load(source), is_mjcf=True))
    assert {"timestep", "integrator", "autoreset", "timer"} <= settings.keys()
    for knob, values in settings.items():
        assert len({value.label for value in values}) == len(values)
        for value in values:
            assert value.knob == knob
            assert value.edits or value.loop != NO_CHANGE
            model = apply(mujoco.MjSpec.from_file(str(source.path)), [value])
            mujoco.mj_step(model, mujoco.MjData(model), 3)


TENDONS = """<tendon>
  <fixed name='drawn'><joint joint='j' coef='1'/></fixed>
  <fixed name='pulled'><joint joint='j' coef='1'/></fixed>
  <fixed name='stiff' stiffness='2'><joint joint='j' coef='1'/></fixed>
  <fixed name='read'><joint joint='j' coef='1'/></fixed>
</tendon><actuator><motor tendon='pulled'/></actuator><sensor><tendonpos tendon='read'/></sensor>"""


def test_tendons_that_nothing_uses_are_left_out() -> None:
    xml = model_xml(bodies=ARM.replace("<joint", "<joint name='j'"), more=TENDONS)
    (setting,) = knobs.settings(seen(xml))["tendons"]
    assert setting.edits == (Edit(Part.TENDON, "drawn", ""),)
    assert setting.evidence == "nothing uses 1 of 4 tendons"
    assert apply(mujoco.MjSpec.from_string(xml), [setting]).ntendon == 3
    assert offered(seen(model_xml()), "tendons") == []


SIGNED_DISTANCE = """<mujoco><asset>
  <mesh name='m' vertex='0 0 0 1 0 0 0 1 0 0 0 1'/>
</asset><worldbody>
  <body><freejoint/><geom type='{0}' mesh='m'/></body><geom type='plane' size='1 1 1'/>
</worldbody></mujoco>"""


def test_signed_distances_are_iterated_less_where_a_geom_has_them() -> None:
    some, none = (seen(SIGNED_DISTANCE.format(kind)) for kind in ("sdf", "mesh"))
    assert offered(some, "sdf_iterations") == ["sdf_iterations=5", "sdf_iterations=3"]
    assert offered(some, "sdf_initpoints") == [
        "sdf_initpoints=20",
        "sdf_initpoints=10",
        "sdf_initpoints=5",
    ]
    assert offered(none, "sdf_iterations") == offered(none, "sdf_initpoints") == []


@pytest.mark.parametrize(("nvertex", "is_large"), [(400, False), (600, True)])
def test_smaller_hulls_are_offered_where_a_mesh_has_many_vertices(
    nvertex: int, is_large: bool
) -> None:
    points = np.random.default_rng(0).standard_normal((nvertex, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    vertices = " ".join(f"{value:.5f}" for value in points.ravel())
    xml = (
        f"<mujoco><asset><mesh name='m' vertex='{vertices}'/></asset><worldbody>"
        "<body><freejoint/><geom type='mesh' mesh='m'/></body><geom type='plane' size='1 1 1'/>"
        "</worldbody></mujoco>"
    )
    settings = knobs.settings(seen(xml)).get("maxhullvert", ())
    assert [each.label for each in settings] == ["maxhullvert=64"] * is_large
    for setting in settings:
        assert setting.evidence == "the convex hull of a mesh that collides has 600 vertices"
        smaller = apply(mujoco.MjSpec.from_string(xml), [setting])
        assert features.hull_vertices(smaller) == 64
    assert offered(seen(xml, is_mjcf=False), "maxhullvert") == []


def test_sleep_is_offered_where_most_geoms_are_static() -> None:
    boxes = "".join(f"<geom type='box' size='.1 .1 .1' pos='{i} 0 0'/>" for i in range(9))
    (setting,) = knobs.settings(seen(model_xml(bodies=boxes + ARM)))["sleep"]
    assert setting.evidence == "9 of 10 geoms are static, and skipped with it"
    assert knobs.counted_gain(setting, {"kinematics": 0.8}) == pytest.approx(0.72)
    assert knobs.halves(setting, {"kinematics": 0.8})


def test_iterations_against_slip_are_counted_with_those_of_the_solver() -> None:
    observed = seen(model_xml("noslip_iterations='60'"), solver=Usage(63, 65))
    (setting,) = knobs.settings(observed)["noslip_iterations"]
    assert knobs.counted_gain(setting, {"constraint solver": 0.9}) == pytest.approx(0.9 * 60 / 63)


def test_timesteps_say_why_up_to_the_usual_one() -> None:
    settings = knobs.settings(seen(model_xml("timestep='0.001'")))["timestep"]
    assert [each.evidence for each in settings] == ["1000 steps a simulated second", "", ""]


def test_idle_pairs_become_one_setting_and_no_longer_collide(brief: None) -> None:
    xml = rods(10, 20)
    observed = observe_model(mujoco.MjModel.from_xml_string(xml), True)
    excludes = knobs.settings(observed)["excludes"]
    assert len(excludes) == 1 and len(excludes[0].edits) == 200
    assert excludes[0].label == "exclude 200 pairs"
    assert excludes[0].evidence == (
        f"200 pairs never touched in {observed.simulated_s:g} s of simulation and 100 random poses;"
        " the closest came within 0.015 m"
    )
    model = apply(mujoco.MjSpec.from_string(xml), excludes)
    assert model.nexclude == 200
    again = observe_model(model, is_mjcf=True)
    assert offered(again, "excludes") == []


def test_where_everything_touches_nothing_is_excluded(brief: None) -> None:
    bodies = "".join(
        f"<body name='b{i}' pos='{0.1 * i} 0 0'><joint axis='0 0 1'/><geom size='.2'/></body>"
        for i in range(3)
    )
    model = mujoco.MjModel.from_xml_string(model_xml(bodies=bodies))
    assert offered(observe_model(model, is_mjcf=True), "excludes") == []


def test_evidence_of_excludes_says_what_is_left_out() -> None:
    pair = IdlePair("a", "b", None)
    some = seen(rods(1, 1), idle_pairs=(pair,), nposes=0, unnamed_idle_pairs=2)
    (setting,) = knobs.settings(some)["excludes"]
    assert setting.edits == (Edit(Part.EXCLUDE, "a", "b"),)
    assert setting.evidence == (
        "1 pair never touched in 20 s of simulation;"
        " 2 more cannot be excluded, as a body has no name"
    )


@pytest.mark.parametrize("nv", [59, 60])
def test_auto_is_sparse_from_60_degrees_of_freedom_on(nv: int) -> None:
    bodies = "".join(ARM for _ in range(nv))
    other = {}
    for jacobian in ("auto", "dense", "sparse"):
        some = seen(model_xml(f"jacobian='{jacobian}'", bodies))
        other[jacobian] = offered(some, "jacobian")
        if jacobian == "auto":  # what the engine says
            assert mujoco.mj_isSparse(some.model) == (nv >= 60)
    assert other["dense"] == ["jacobian=sparse"]
    assert other["sparse"] == ["jacobian=dense"]
    assert other["auto"] == [f"jacobian={'dense' if nv >= 60 else 'sparse'}"]


def test_without_constraints_nothing_about_them_is_offered() -> None:
    never = Usage(0, 0)
    some = seen(model_xml(), solver=never, line_search=never, max_contacts=0, max_constraints=0)
    about = {"jacobian", "solver", "tolerance", "iterations", "ls_iterations", "cone", "island"}
    assert not about & knobs.settings(some).keys()


@pytest.mark.parametrize(
    ("present", "others"),
    [
        ("RK4", ["Euler", "implicitfast", "discrete", "implicit"]),
        ("implicit", ["Euler", "implicitfast", "discrete"]),
        ("Euler", ["implicitfast", "discrete"]),
        ("implicitfast", ["Euler", "discrete"]),
    ],
)
def test_integrators_that_are_no_slower_are_offered(present: str, others: list[str]) -> None:
    some = seen(model_xml(f"integrator='{present}'"))
    assert offered(some, "integrator") == [f"integrator={other}" for other in others]


def test_an_integrator_that_the_engine_refuses_is_not_offered() -> None:
    cloth = models.load(models.resolve("cloth"))
    assert offered(replace(seen(model_xml()), model=cloth), "integrator") == [
        "integrator=implicitfast"
    ]


def test_timesteps_are_doubled() -> None:
    assert offered(seen(model_xml("timestep='1e-4'")), "timestep") == [
        "timestep=0.0002",
        "timestep=0.0004",
        "timestep=0.0008",
    ]


def test_bounds_are_below_what_steps_use() -> None:
    some = seen(model_xml(), solver=Usage(3, 8), line_search=Usage(2, 9))
    (first, *_), searches = knobs.settings(some)["iterations"], offered(some, "ls_iterations")
    assert offered(some, "iterations") == ["iterations=1", "iterations=2", "iterations=4"]
    assert searches == ["ls_iterations=2", "ls_iterations=4", "ls_iterations=8"]
    assert first.evidence == "observed steps take 3 solver iterations in the median and 8 at most"


def test_tolerances_are_above_the_present_one() -> None:
    some = seen(model_xml("tolerance='1e-6'"))
    assert offered(some, "tolerance") == ["tolerance=1e-05", "tolerance=0.0001"]


def test_noslip_is_turned_off_where_it_is_on() -> None:
    assert offered(seen(model_xml("noslip_iterations='3'")), "noslip_iterations") == [
        "noslip_iterations=0"
    ]
    assert offered(seen(model_xml()), "noslip_iterations") == []


def test_the_convex_collider_matters_where_geoms_need_it() -> None:
    knob_names = {"ccd_iterations", "ccd_tolerance", "nativeccd", "multiccd"}
    pair = "<body><freejoint/><geom type='{0}' size='.1 .1 .1'/></body>" * 2
    for kind, needs in (("box", False), ("sphere", False), ("ellipsoid", True)):
        some = seen(model_xml(bodies=pair.format(kind)))
        assert (knob_names & knobs.settings(some).keys()) == (knob_names if needs else set())
    one = pair.format("ellipsoid")[: len(pair.format("ellipsoid")) // 2]
    on_plane = seen(model_xml(bodies=f"<geom type='plane' size='1 1 1'/>{one}"))
    assert not knob_names & knobs.settings(on_plane).keys()


def test_flags_go_both_ways() -> None:
    assert offered(flagged("warmstart='enable'"), "warmstart") == ["warmstart=disable"]
    assert offered(flagged("warmstart='disable'"), "warmstart") == ["warmstart=enable"]
    assert offered(flagged("energy='enable'"), "energy") == ["energy=disable"]
    assert offered(flagged("energy='disable'"), "energy") == []


def test_sleep_is_offered_where_a_tree_may_sleep() -> None:
    loose = "<body><freejoint/><geom size='.1'/></body>"
    assert offered(seen(model_xml(bodies=loose)), "sleep") == ["sleep=enable"]
    never = loose.replace("<body>", "<body sleep='never'>")
    assert offered(seen(model_xml(bodies=never)), "sleep") == []


def test_islands_are_none_of_pgs() -> None:
    assert offered(seen(model_xml("solver='Newton'")), "island") == ["island=disable"]
    assert offered(seen(model_xml("solver='PGS'")), "island") == []


def test_explicit_damping_is_offered_with_euler_and_damping() -> None:
    assert offered(seen(model_xml()), "eulerdamp") == ["eulerdamp=disable"]
    assert offered(seen(model_xml("integrator='implicitfast'")), "eulerdamp") == []
    undamped = ARM.replace("damping='.1'", "")
    assert offered(seen(model_xml(bodies=undamped)), "eulerdamp") == []


def test_sensors_are_lost() -> None:
    arm = ARM.replace("<joint", "<joint name='j'")
    some = seen(model_xml(bodies=arm, more="<sensor><jointpos joint='j'/></sensor>"))
    (setting,) = knobs.settings(some)["sensor"]
    assert setting.edits == (Edit(Part.FLAG, "sensor", "disable"),)
    assert setting.loses == "sensor data"
    assert offered(seen(model_xml()), "sensor") == []


def test_unused_features_are_disabled_together() -> None:
    (setting,) = knobs.settings(seen(model_xml()))["unused_features"]
    # limits, damping, and one geom, which nothing can meet
    names = {edit.name for edit in setting.edits}
    assert names == {"equality", "frictionloss", "contact", "actuation", "sensor", "spring"}
    assert {edit.value for edit in setting.edits} == {"disable"}
    assert setting.evidence == (
        "the model has no equality constraints, no friction loss, no geoms that can collide,"
        " no actuators, no sensors, no springs"
    )


@pytest.mark.parametrize(
    ("option", "bodies", "expected"),
    [
        ("", ARM.replace("damping='.1'", "").replace("limited='true'", "limited='false'"), 2),
        ("density='1'", ARM.replace("damping='.1'", ""), 1),
        ("", ARM.replace("damping='.1'", "").replace("<body>", "<body gravcomp='1'>"), 1),
    ],
)
def test_unused_features_change_nothing(option: str, bodies: str, expected: int) -> None:
    xml = model_xml(option, bodies)
    settings = knobs.settings(seen(xml))["unused_features"]
    assert len({"spring", "damper"} & {edit.name for edit in settings[0].edits}) == expected
    before, after = (
        mujoco.MjModel.from_xml_string(xml),
        apply(mujoco.MjSpec.from_string(xml), settings),
    )
    qpos = []
    for model in (before, after):
        data = mujoco.MjData(model)
        data.qvel[:] = 0.3
        mujoco.mj_step(model, data, 50)
        qpos.append(data.qpos.tolist())
    assert qpos[0] == qpos[1]


def test_geoms_that_are_only_drawn_can_be_discarded() -> None:
    drawn = "<geom name='drawn' size='.1' contype='0' conaffinity='0' mass='0'/></body>"
    bodies = ARM.replace("</body>", drawn)
    some = seen(model_xml(bodies=bodies))
    (setting,) = knobs.settings(some)["visual_geoms"]
    assert setting.evidence == "1 geom is only drawn"
    assert apply(mujoco.MjSpec.from_string(model_xml(bodies=bodies)), [setting]).ngeom == 1
    sensor = "<sensor><framepos objtype='geom' objname='drawn'/></sensor>"
    assert offered(seen(model_xml(bodies=bodies, more=sensor)), "visual_geoms") == []


def test_bodies_that_cannot_move_in_their_parents_are_merged_into_them() -> None:
    bodies = ARM.replace("</body>", "<body><geom size='.1'/></body></body><body mocap='true'/>")
    (setting,) = knobs.settings(seen(model_xml(bodies=bodies)))["fusestatic"]
    assert setting.evidence == "1 of 3 bodies have no joint"
    assert apply(mujoco.MjSpec.from_string(model_xml(bodies=bodies)), [setting]).nbody == 3
    assert offered(seen(model_xml()), "fusestatic") == []


def test_a_file_that_is_not_mjcf_has_no_compiler_settings() -> None:
    drawn = "<geom size='.1' contype='0' conaffinity='0' mass='0'/></body>"
    compiled = seen(
        model_xml(bodies=ARM.replace("</body>", drawn)),
        is_mjcf=False,
        idle_pairs=(IdlePair("a", "b", 0.1),),
    )
    parts = {
        edit.part
        for settings in knobs.settings(compiled).values()
        for setting in settings
        for edit in setting.edits
    }
    assert parts == {Part.OPTION, Part.FLAG}


def test_what_a_release_lacks_is_not_offered(monkeypatch: pytest.MonkeyPatch) -> None:
    bodies = "<body><freejoint/><geom size='.1'/></body>"
    assert {"sleep", "island", "autoreset"} <= knobs.settings(seen(model_xml(bodies=bodies))).keys()
    for enum, prefix in (("mjtDisableBit", "mjDSBL_"), ("mjtEnableBit", "mjENBL_")):
        older = SimpleNamespace(
            **{
                name: getattr(getattr(mujoco, enum), name)
                for name in dir(getattr(mujoco, enum))
                if name.startswith(prefix) and not name.endswith(("SLEEP", "ISLAND", "AUTORESET"))
            }
        )
        monkeypatch.setattr(mujoco, enum, older)
    integrators = {
        name: getattr(mujoco.mjtIntegrator, f"mjINT_{name}") for name in ("EULER", "IMPLICITFAST")
    }
    older = SimpleNamespace(**{f"mjINT_{name}": value for name, value in integrators.items()})
    monkeypatch.setattr(mujoco, "mjtIntegrator", older)
    monkeypatch.delattr(mujoco, "mju_threadpool")
    some = seen(model_xml(bodies=bodies))
    names = knobs.settings(some).keys()
    assert not {"sleep", "island", "autoreset", "engine_threads"} & names
    assert "warmstart" in names
    assert offered(some, "integrator") == ["integrator=implicitfast"]


def test_a_flag_that_enabled_in_older_releases_is_the_same_knob(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    older = SimpleNamespace(mjENBL_ISLAND=1 << 10, mjENBL_ENERGY=2)
    monkeypatch.setattr(mujoco, "mjtEnableBit", older)
    monkeypatch.setattr(mujoco, "mjtDisableBit", SimpleNamespace())
    model = seen(model_xml()).model
    assert compat.flag_enabled(model, "island") is False
    model_options.set_flag(model.opt, "island", "enable")
    assert compat.flag_enabled(model, "island") is True
    assert model.opt.enableflags == 1 << 10
    model_options.set_flag(model.opt, "island", "disable")
    assert model.opt.enableflags == 0


def test_the_loop_has_a_clock_and_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    cores = SimpleNamespace(thread_counts=lambda: (1, 4, 8))
    monkeypatch.setattr(knob_values.topology, "read", lambda: cores)
    settings = knobs.settings(seen(model_xml()))
    assert [each.loop for each in settings["timer"]] == [LoopChange(is_clock_off=True)]
    threads = [each.loop for each in settings["engine_threads"]]
    assert threads == [LoopChange(engine_threads=4), LoopChange(engine_threads=8)]
    monkeypatch.setattr(
        knob_values.topology, "read", lambda: SimpleNamespace(thread_counts=lambda: (1,))
    )
    assert "engine_threads" not in knobs.settings(seen(model_xml()))


def test_a_knob_of_a_run_file_that_does_not_exist_is_refused() -> None:
    with pytest.raises(InputError, match="did you mean jacobian"):
        knobs.find("jacobean")
