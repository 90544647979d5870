"""Steps to the poses of views, each done once though a calibration is stopped and begun again.

Every result passes through bytes, stored or not, so that a run which goes on has the very models of one that
was not stopped. A model that was stopped while it grew goes on from its views of at most `EVERY` seconds ago,
and differs by what the mapper forgets: the views that it tried in vain, and when it adjusted the whole model.
"""

import hashlib
import json
import time
from collections.abc import Callable
from dataclasses import dataclass, field, fields, is_dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from pydantic import BaseModel

from calib.data.unfinished import EVERY, Arrays, Unfinished
from imaging.files import store
from imaging.files.colmap import pycolmap


@dataclass(frozen=True, eq=False)
class Done:
    """Result of a step: pycolmap models, None for one that cannot be made, and the rest, as JSON has it."""

    models: tuple[Any | None, ...] = ()
    rest: dict[str, Any] = field(default_factory=dict)


class Growth:
    """Model that grows in a step, kept now and then; name: of the step."""

    def __init__(self, unfinished: Unfinished, name: str) -> None:
        self._unfinished, self._name, self._since = unfinished, f"growth in {name}", time.monotonic()

    def before(self) -> Any | None:
        """Return the model as a stopped run kept it, or None."""
        arrays = self._unfinished.large(self._name)
        return None if arrays is None else _done(arrays).models[0]

    def keep(self, model: Any) -> None:
        """Keep the model as it is, unless that was done lately or nothing is kept.

        Raises:
            StorageError: The disk refuses.
        """
        if self._unfinished.in_files and time.monotonic() - self._since > EVERY:
            self._unfinished.keep_large(self._name, _arrays(Done((model,))))
            self._since = time.monotonic()


class Steps:
    """Steps of one attempt at the poses, known by their order: the same inputs lead to the same steps."""

    def __init__(self, unfinished: Unfinished, inputs: object) -> None:
        asked = json.dumps(inputs, sort_keys=True, default=_plain)
        self._unfinished, self._count = unfinished, 0
        self._attempt = hashlib.sha256(asked.encode()).hexdigest()

    def result(self, step: Callable[[], Done]) -> Done:
        """Return the result of the next step, which is done unless a stopped run has done it.

        Raises:
            StorageError: The disk refuses.
        """
        self._count += 1
        name = self._name(self._count)
        arrays = self._unfinished.large(name)
        if arrays is None:
            arrays = _arrays(step())
            self._unfinished.keep_large(name, arrays)
        return _done(arrays)

    def model(self, step: Callable[[], Any | None]) -> Any | None:
        """Return the model of the next step, whose result is nothing but that."""
        return self.result(lambda: Done((step(),))).models[0]

    def grown(self, step: Callable[[Growth], Any | None]) -> Any | None:
        """Return the model of the next step, which goes on from what a stopped run kept of it."""
        growth = Growth(self._unfinished, self._name(self._count + 1))
        return self.model(lambda: step(growth))

    def _name(self, number: int) -> str:
        return f"step {number} of {self._attempt}"


def _plain(value: Any) -> Any:
    """Return what JSON can hold of an input, with every digit."""
    if isinstance(value, BaseModel):
        return value.model_dump(mode="json")
    if is_dataclass(value):
        return {one.name: getattr(value, one.name) for one in fields(value)}
    return sorted(value) if isinstance(value, set | frozenset) else np.asarray(value).tolist()


def _arrays(done: Done) -> Arrays:
    """All of a result, as files keep it; `_done` is the inverse."""
    arrays: Arrays = {"models": np.array(len(done.models)), "rest": np.array(json.dumps(done.rest))}
    for number, model in enumerate(done.models):
        if model is None:
            continue
        with TemporaryDirectory(prefix="rig-") as folder:
            try:
                model.write_binary(folder)
            except RuntimeError as error:  # which is how pycolmap reports a full disk
                raise store.refused(folder, OSError(str(error))) from error
            for file in sorted(Path(folder).iterdir()):
                arrays[f"{number} {file.name}"] = np.frombuffer(file.read_bytes(), np.uint8)
    return arrays


def _done(arrays: Arrays) -> Done:
    models: list[Any | None] = []
    for number in range(int(arrays["models"])):
        files = {name.split()[1]: one for name, one in arrays.items() if name.startswith(f"{number} ")}
        if not files:
            models.append(None)
            continue
        with TemporaryDirectory(prefix="rig-") as folder:
            for name, content in files.items():
                store.write_bytes(Path(folder) / name, content.tobytes())
            models.append(pycolmap.Reconstruction(folder))
    return Done(tuple(models), json.loads(str(arrays["rest"])))
