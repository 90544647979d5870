"""Records: what is written to disk as JSON, frozen and strict, and how it is read again."""

from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ConfigDict, ValidationError

from imaging.errors import InputError

RecordT = TypeVar("RecordT", bound=BaseModel)


SCHEMA_VERSION = 1


class Record(BaseModel):
    """Base of everything written to disk: frozen, strict about fields, no NaN."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


def parse(model: type[RecordT], value: Any, where: Path | str) -> RecordT:
    """Validate a value read from a file; InputError of one sentence that names file and field."""
    if isinstance(value, dict) and "schema_version" in value and value["schema_version"] != SCHEMA_VERSION:
        raise InputError(
            f"{where} has schema version {value['schema_version']!r}, this rig reads {SCHEMA_VERSION}: "
            "open it with the version of rig that wrote it."
        )
    try:
        return model.model_validate(value)
    except ValidationError as error:
        first = error.errors()[0]
        field = ".".join(str(part) for part in first["loc"]) or "the record"
        raise InputError(f"{where}: {field}: {first['msg'].lower()}; correct or restore the file.") from error
