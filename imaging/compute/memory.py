"""The memory that a file asks for, compared with what the machine has before any of it is taken."""

import os
from pathlib import Path

from imaging.errors import InputError

MOST_PIXELS = 1 << 29
"""Pixels beyond which a header is taken for damaged: twice the largest cameras there are."""

PER_SAMPLE = 28
"""Bytes, at most, that reading a picture takes for each of its samples: its number in the file and in
float32, with copies of both. Measured of every format: 6 to 24 (half-float EXR of other primaries)."""

UNASKED = 1 << 22
"""Bytes that are taken without asking the system what it has, which takes longer than reading them."""

GIVEN = "RIG_MEMORY"
"""Variable of the environment: bytes that this process may take in all, where several share a machine."""

_GROUPS, _OWN_GROUPS = Path("/sys/fs/cgroup"), Path("/proc/self/cgroup")
_MEMINFO = Path("/proc/meminfo")
_STATM = Path("/proc/self/statm")


def available() -> int:
    """Bytes that this process may still take: of the machine, its control group, its limit and its share."""
    bounds = [_machine(), _group(), _address_space(), _given()]
    return max(min(bound for bound in bounds if bound is not None), 0)


def resident() -> int:
    """Bytes of memory that this process has; 0 on a system that does not say."""
    try:
        return int(_STATM.read_text("ascii").split()[1]) * os.sysconf("SC_PAGE_SIZE")
    except (OSError, ValueError, AttributeError):
        return 0


def check_picture(name: str, width: int, height: int, channels: int = 3) -> None:
    """Refuse a picture that is larger than any, or than the memory.

    Args:
        name: Name of the picture, which begins the sentence of an error.
        width: Width that its header states, px.
        height: Height that its header states, px.
        channels: Samples of each pixel.

    Raises:
        InputError: The size is not positive, has more than MOST_PIXELS pixels, or does not fit into the
            memory.
    """
    if width <= 0 or height <= 0:
        raise InputError(f"{name} is damaged, since it claims {width}x{height} pixels: copy it again.")
    if width * height > MOST_PIXELS:
        raise InputError(
            f"{name} claims {width}x{height} pixels, and rig reads {MOST_PIXELS // 10**6} million at most: "
            "copy it again if that is damage, else scale it down."
        )
    check(f"{name} has {width}x{height} pixels", PER_SAMPLE * width * height * max(channels, 1))


def check(what: str, need: int) -> None:
    """Raise InputError unless that many bytes are free, or they are few; `what` begins its sentence."""
    if need <= UNASKED:
        return
    free = available()
    if need > free:
        raise InputError(
            f"{what}, which takes {text(need)} of memory where {text(free)} are free: scale it down, "
            "or read it on a machine with more."
        )


def _machine() -> int | None:
    """Return what the system would give without swapping, else all of its memory."""
    try:
        for line in _MEMINFO.read_text("ascii").splitlines():
            if line.startswith("MemAvailable:"):
                return 1024 * int(line.split()[1])
        return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (OSError, ValueError, AttributeError, IndexError):
        return 1 << 33  # a system that does not say: as a small machine


def _group() -> int | None:
    """Return what the limits of control groups leave, file caches not counted, or None without one."""
    limits = []
    for folder in (_GROUPS / "memory", _GROUPS, *_own_groups()):
        for limit, usage in (
            ("memory.max", "memory.current"),
            ("memory.limit_in_bytes", "memory.usage_in_bytes"),
        ):
            try:
                most, used = (int((folder / name).read_text("ascii")) for name in (limit, usage))
                stat = dict(line.split() for line in (folder / "memory.stat").read_text("ascii").splitlines())
            except (OSError, ValueError):  # no such group, or the word "max"
                continue
            cached = stat.get("total_inactive_file", stat.get("inactive_file", "0"))
            limits.append(most - used + int(cached))
    return min(limits, default=None)


def _own_groups() -> list[Path]:
    """Folders of the group that this process is in, and of those around it, whose limits hold for it too, of
    either version of control groups.
    """
    try:
        lines = _OWN_GROUPS.read_text("utf-8").splitlines()
    except (OSError, ValueError):
        return []
    paths = {controllers: path.lstrip("/") for _, controllers, path in (line.split(":", 2) for line in lines)}
    bases = {"": _GROUPS, "memory": _GROUPS / "memory"}
    return [
        base.joinpath(*parts[:count])
        for controllers, base in bases.items()
        for parts in [Path(paths.get(controllers, "")).parts]
        for count in range(1, len(parts) + 1)
    ]


def _address_space() -> int | None:
    """Bytes that `ulimit -v` leaves of the address space; None without such a limit, as always on Windows."""
    try:
        import resource
    except ImportError:
        return None
    most = resource.getrlimit(resource.RLIMIT_AS)[0]
    if most == resource.RLIM_INFINITY:
        return None
    try:
        return most - int(_STATM.read_text("ascii").split()[0]) * os.sysconf("SC_PAGE_SIZE")
    except (OSError, ValueError):
        return most


def _given() -> int | None:
    """Return what is left of the share that the starting process granted; None if it granted none."""
    given = os.environ.get(GIVEN, "")
    return int(given) - resident() if given.isdecimal() else None


def text(size: int) -> str:
    """A number of bytes as MB or GB."""
    return f"{size / 1e9:.1f} GB" if size >= 10**9 else f"{size / 1e6:.0f} MB"
