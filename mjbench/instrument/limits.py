"""The most that a user can ask for."""

# Threads or worker processes: more than cores can use, and about as many as a system lets one user
# start.
MAX_THREADS = 1024
# Anything else that is counted, such as steps: MuJoCo counts in 32 bits.
MAX_COUNT = 2**31 - 1
