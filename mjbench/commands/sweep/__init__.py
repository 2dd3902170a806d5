"""A matrix of measurements on several machines."""
