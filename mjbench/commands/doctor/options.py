"""The options of `mjbench doctor`."""

from dataclasses import dataclass

from mjbench.commands.shared_options import FormOptions, WholeBudgetOptions


@dataclass(frozen=True, kw_only=True)
class DoctorOptions(WholeBudgetOptions, FormOptions):
    """How the machine is examined."""

    EACH_S, QUICK_S = 18.0, 12.0
