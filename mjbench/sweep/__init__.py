"""Sweeps: a matrix of models, releases, paths and machines, measured on the nodes of a cluster."""
