"""One environment of each of five suites, for `mjbench env`.

    cd docs/examples
    pip install dm_control gymnasium-robotics metaworld robosuite
    mjbench env Humanoid-v5 dm_control:humanoid-walk gymnasium_robotics:FetchPickAndPlace-v4 \
      suites:metaworld suites:robosuite
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
