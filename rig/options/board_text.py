"""A board in one word on the command line: `7x5,square=150mm,marker=112.5mm,DICT_4X4_50`."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import typer

if TYPE_CHECKING:
    from imaging.session.records import Board

EXAMPLE = "7x5,square=150mm,marker=112.5mm,DICT_4X4_50"
_UNITS = {"mm": 1e-3, "cm": 1e-2, "m": 1.0}


class BoardText(str):
    """Board option; parsed when it is needed, since OpenCV takes a while to load."""

    def board(self) -> Board:
        """The board; InputError of one sentence that says what is wrong with the text."""
        from pydantic import ValidationError

        from imaging.errors import InputError
        from imaging.session.records import Board

        fields: dict[str, object] = {}
        for part in self.split(","):
            word = part.strip()
            if size := re.fullmatch(r"(\d+)x(\d+)", word):
                fields |= {"columns": int(size[1]), "rows": int(size[2])}
            elif length := re.fullmatch(r"(square|marker)=(\d+(?:\.\d+)?)(mm|cm|m)", word):
                fields[length[1]] = float(length[2]) * _UNITS[length[3]]
            elif word.upper().startswith("DICT_"):
                fields["dictionary"] = word.upper()
            else:
                raise InputError(
                    f"{word!r} does not describe a board: give columns x rows and sizes, as {EXAMPLE}."
                )
        try:
            return Board.model_validate(fields)
        except ValidationError as error:
            first = error.errors()[0]
            what = ".".join(str(place) for place in first["loc"])
            message = first["msg"].removeprefix("Value error, ").lower()
            raise InputError(
                f"{str(self)!r} is not a board ({f'{what}: ' if what else ''}{message}): "
                f"describe it as {EXAMPLE}."
            ) from None


def board_text(text: str) -> BoardText:
    """Parse for typer."""
    if not text.strip():
        raise typer.BadParameter(f"describe the board, as {EXAMPLE}")
    return BoardText(text)
