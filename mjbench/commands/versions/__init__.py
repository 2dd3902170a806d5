"""Which release, revision or function is slower or does other work: `versions`, `ab`, `bisect`."""
