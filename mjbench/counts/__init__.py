"""Instruction counts: measured with Callgrind, and compared between releases by function."""
