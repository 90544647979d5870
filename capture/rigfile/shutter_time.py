"""Shutter times as people write them."""

import math
import re


def seconds_of(text: str) -> float:
    """`1/30`, `0.5` or `2s` as seconds; ValueError otherwise."""
    match = re.fullmatch(r"\s*(?:(1)\s*/\s*)?(\d+(?:\.\d+)?)\s*s?\s*", text)
    value = float(match[2]) if match else 0.0
    if not (value > 0 and math.isfinite(value)):
        raise ValueError("write a shutter time as 1/30, 0.5 or 2s")
    return 1.0 / value if match and match[1] else value
