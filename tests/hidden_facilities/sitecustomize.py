"""Python imports this at its start: in every process below one whose environment asks for it."""

import os

if os.environ.get("MJBENCH_TEST_PLATFORM") == "darwin":
    import other_platforms

    other_platforms.hide_what_macos_lacks()
