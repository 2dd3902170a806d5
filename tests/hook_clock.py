"""A clock for tests of the clocks in a program."""


class Clock:
    """A clock that moves by a microsecond each time it is read."""

    def __init__(self):
        self.now_ns = 0

    def __call__(self):
        self.now_ns += 1000
        return self.now_ns
