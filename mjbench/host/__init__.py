"""This machine: what it is and does now, and the child processes that mjbench starts on it."""
