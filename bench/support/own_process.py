"""Rows made in processes of their own, whose processor seconds and memory are those of nothing else."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any


def row_of(module: str, program: str, *arguments: str | Path) -> dict[str, Any]:
    """Return what `PROGRAMS[program]` of a bench makes of its arguments, called in another process.

    Args:
        module: Name of the bench's module.
        program: Key of its PROGRAMS.
        arguments: What the function is called with.

    Raises:
        subprocess.CalledProcessError: It failed; its traceback was printed.
    """
    given = ", ".join(f"Path({str(one)!r})" if isinstance(one, Path) else repr(one) for one in arguments)
    code = (
        "import json; from pathlib import Path; from importlib import import_module; "
        f"print(json.dumps(import_module({module!r}).PROGRAMS[{program!r}]({given})))"
    )
    done = subprocess.run([sys.executable, "-c", code], check=True, stdout=subprocess.PIPE, text=True)
    return dict(json.loads(done.stdout.splitlines()[-1]))
