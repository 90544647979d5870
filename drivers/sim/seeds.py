"""Random numbers that depend on what they are for, not on the order in which they are drawn."""

import hashlib

import numpy as np


def generator(*purpose: object) -> np.random.Generator:
    """A generator for a purpose, such as (seed, serial, "pattern"): equal purposes, equal numbers.

    The purpose is spelled with repr(), which is exact for the numbers and strings used here.
    """
    digest = hashlib.sha256(repr(purpose).encode()).digest()
    return np.random.Generator(np.random.Philox(key=int.from_bytes(digest[:16], "little")))
