"""Measure what a step of each shipped model costs, and write the table that comes with the package.

    python -m benchmarks.studies.shipped_step_costs

Do it when a model changed.
"""


def main() -> None:
    """Write the table of the shipped models."""
    # asv imports this module where packages of these are missing
    from mjbench.simulation import models, workload_sampling
    from mjbench.simulation.model_digest import model_digest
    from mjbench.verification import step_costs

    loaded = [models.load(models.resolve(name)) for name in models.shipped()]
    costs = {model_digest(model): workload_sampling.settled_step_s(model) for model in loaded}
    table = {digest: float(f"{seconds:.2g}") for digest, seconds in costs.items()}
    step_costs.SHIPPED.write_text(step_costs.as_text(table))


if __name__ == "__main__":
    main()
