"""Studies: what measured and simulated the results in `results/`, and writes pages from them."""
