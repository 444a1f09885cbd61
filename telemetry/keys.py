"""Key expressions of a cell: `deltaph/{cell}/...`."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Literal, get_args

from deltaph.frame import Command

MessageName = Literal["setpoint", "actual", "timing", "plan", "event"]
QueryName = Literal["schema", "plan", "scenario", "summary"]

MESSAGE_NAMES: tuple[MessageName, ...] = get_args(MessageName)
QUERY_NAMES: tuple[QueryName, ...] = get_args(QueryName)
FRAME_MESSAGES: tuple[MessageName, ...] = ("setpoint", "actual", "timing")
"""One of each per frame; a plan comes when one is accepted or refused, an event when something happens."""

_CHUNK = re.compile(r"[A-Za-z0-9_.-]+")


@dataclass(frozen=True, slots=True)
class CellKeys:
    """The keys of one cell.

    Attributes:
        cell: its name, one chunk of a key: letters, digits, `_`, `.` and `-`.

    Raises:
        ValueError: the name is not one plain chunk of a key.
    """

    cell: str

    def __post_init__(self) -> None:
        if not _CHUNK.fullmatch(self.cell):
            raise ValueError(f"cell name {self.cell!r} does not fit into a Zenoh key: use letters, digits, '_', '.' and '-' only")

    @property
    def token(self) -> str:
        """The liveliness token: there as long as the cell is."""
        return f"deltaph/{self.cell}"

    @property
    def everything(self) -> str:
        """Key expression of all the cell's messages."""
        return f"deltaph/{self.cell}/*"

    def command(self, name: Command) -> str:
        """The key of a command to the cell."""
        return f"deltaph/{self.cell}/command/{name}"

    @property
    def publishers(self) -> str:
        """Key expression of the tokens of the messages' publishers: `deltaph/{cell}/{message}/@adv/pub/{session}/{entity}/_`."""
        return f"deltaph/{self.cell}/*/@adv/pub/**"

    def kept(self, name: MessageName, session: str, entity: int) -> str:
        """Where a publisher, which is an entity of a session, answers with the messages that it keeps."""
        return f"{self.of(name)}/@adv/pub/{session}/{entity}/**"

    def of(self, name: MessageName | QueryName) -> str:
        """The key of a message, or of a query."""
        return f"deltaph/{self.cell}/{name}"
