"""Engines that compile, without most of their optimisation: it takes longer than it saves here."""

from typing import Any

from mjbench.paths import warp
from mjbench.paths.accelerated import Compiled
from mjbench.paths.mjx import Mjx64, MjxWarp
from mjbench.paths.warp import Warp
from mjbench.simulation.workload import Workload

# What has Warp compile without optimisation, and without inlining all that it can.
QUICK_WARP = (
    "import warp\n"
    "warp.config.optimization_level = 0\n"
    "warp.config.cpu_compiler_flags = '-march=native'\n"
)


def configure_quick_warp() -> None:
    """Have Warp compile quickly, and keep its kernels for all tests."""
    exec(QUICK_WARP, {})


class QuickWarp(Warp):
    """Warp."""

    name = "quick_engines:QuickWarp"

    def compile(self, *arguments: Any) -> Compiled:
        warp.configure_warp = configure_quick_warp
        return super().compile(*arguments)


class QuickMjxWarp(MjxWarp):
    """Warp, called by MJX."""

    name = "quick_engines:QuickMjxWarp"

    def compile(self, *arguments: Any) -> Compiled:
        warp.configure_warp = configure_quick_warp
        return super().compile(*arguments)


class FixedMjx(Mjx64):
    """MJX as it is for a GPU: the number of steps is compiled into the program that is timed.

    What is judged is the program that takes it as an argument, which a CPU would time, too.
    """

    name = "quick_engines:FixedMjx"
    is_fixed = False

    def needs_fixed_nstep(self) -> bool:
        return self.is_fixed

    def compile(self, workload: Workload, *others: Any) -> Compiled:
        self.is_fixed = workload.nstep > 1  # programs of single steps are not timed
        return super().compile(workload, *others)
