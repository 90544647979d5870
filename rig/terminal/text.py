"""Formatting of values for people: safe text, durations, sizes, counts."""

import math
import shlex


def plain(text: object) -> str:
    """One line of text that no terminal takes for a command.

    Control characters, line breaks, direction marks and broken encodings (all of which a file name
    may hold) are shown as escapes.
    """
    return "".join(
        letter if letter.isprintable() else letter.encode("unicode_escape").decode() for letter in str(text)
    )


def sentence(text: object) -> str:
    """`plain`, beginning with a letter as given and ending in one full stop."""
    line = plain(text).strip()
    return line if line.endswith((".", "!", "?")) else f"{line}."


def command_line(*words: object) -> str:
    """A command as it can be pasted into a POSIX shell: words with spaces or signs are quoted."""
    return shlex.join(str(word) for word in words)


def duration(seconds: float) -> str:
    """Seconds as people say them: `8 s`, `2 min 05 s`, `1 h 20 min`."""
    if seconds < 9.95:
        return f"{max(seconds, 0.0):.1f} s"
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60:02d} s"
    return f"{whole // 3600} h {whole % 3600 // 60:02d} min"


def size(count: float) -> str:
    """Bytes with a decimal unit: `3.2 MB`."""
    for unit in ("B", "kB", "MB", "GB"):
        if count < 999.5:  # from which on three digits would be 1000
            return f"{count:.0f} {unit}" if unit == "B" else f"{count:.3g} {unit}"
        count /= 1000
    return f"{count:.3g} TB"


def counted(count: int, noun: str, plural: str | None = None) -> str:
    """`1 shot`, `2 shots`, `40,000 Gaussians`."""
    return f"{count:,} {noun if count == 1 else plural or noun + 's'}"


def number(value: float | None, digits: int = 3) -> str:
    """A value with that many significant digits, never in exponents people cannot read; `n/a` for None."""
    if value is None or not math.isfinite(value):
        return "n/a"
    if value != 0 and (abs(value) >= 1e6 or abs(value) < 1e-4):
        return f"{value:.{digits - 1}e}"
    decimals = digits - 1 - math.floor(math.log10(abs(value))) if value else 0
    return f"{value:,.{max(decimals, 0)}f}"
