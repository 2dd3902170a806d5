"""How things are measured: clocks, statistics, the machine, child processes, run files."""
