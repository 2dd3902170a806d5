"""Whether a release, a revision or a function is slower or does other work: `versions`, `ab`, `bisect`."""
