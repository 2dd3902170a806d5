"""The options of `mjbench doctor`."""

from dataclasses import dataclass

from mjbench.commands.shared_options import FormOptions, budget_option


@dataclass(frozen=True, kw_only=True)
class DoctorOptions(FormOptions):
    """How the machine is examined."""

    budget_s: float = budget_option(12.0, "Time for comparing the cart-pole with itself.")
