"""A seed for each job: its own, and the same however many others there are."""

from __future__ import annotations

import hashlib


def seed_of(seed: int, name: str) -> int:
    """The seed of a job in a study's seed: a number below 2**48, by numpy's SeedSequence.

    It depends on the two alone, so a grid that grows keeps the draws of what it had.
    """
    import numpy as np

    words = np.frombuffer(hashlib.sha256(name.encode()).digest(), dtype="<u4")
    sequence = np.random.SeedSequence(seed, spawn_key=tuple(int(w) for w in words))
    high, low = sequence.generate_state(2)
    return (int(high) << 16) | (int(low) >> 16)
