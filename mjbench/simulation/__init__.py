"""The work itself: models, workloads, what a step did, and whether states agree."""
