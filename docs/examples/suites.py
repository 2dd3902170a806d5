"""Environments of two suites that `mjbench env` has no names for.

    cd docs/examples
    pip install metaworld robosuite "mujoco==3.8.1"
    mjbench env suites:metaworld suites:robosuite

robosuite 1.5.1 does not run with newer releases of MuJoCo than 3.9.0.
"""


def metaworld():
    """Return Meta-World's task of picking and placing."""
    import gymnasium
    import metaworld  # noqa: F401 - registers the id

    return gymnasium.make("Meta-World/MT1", env_name="pick-place-v3")


def robosuite():
    """Return robosuite's task of lifting a cube, without cameras."""
    import robosuite

    return robosuite.make(
        "Lift",
        robots="Panda",
        has_renderer=False,
        has_offscreen_renderer=False,
        use_camera_obs=False,
    )
