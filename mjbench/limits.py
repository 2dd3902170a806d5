"""The most that a user can ask for, and the time limit of a user who asks for none."""

# Threads or worker processes: more than cores can use, and about as many as a system lets one user
# start.
MAX_THREADS = 1024
# Anything else that is counted, such as steps: MuJoCo counts in 32 bits.
MAX_COUNT = 2**31 - 1
# JSON documents hold integers of 64 bits.
MAX_SEED = 2**63 - 1
# The highest rate of paced steps.
MAX_HERTZ = 1e6
# Steps that somebody may take in all.
MAX_LARGE_COUNT = 10**15
# The longest time that can be given: what waits for a process counts milliseconds in 32 bits, and a
# compiler may take several times its limit.
MAX_SECONDS = 86_400.0
# A child process that is silent for longer, in seconds, is killed.
TIME_LIMIT_S = 60.0
