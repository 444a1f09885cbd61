"""Publishes frames over Zenoh, and answers what a newcomer asks."""

from __future__ import annotations

import contextlib
import json
import time
from collections.abc import Callable, Sequence

import zenoh

from deltaph.errors import EnvironmentProblem
from deltaph.frame import Frame
from deltaph.telemetry.keys import CellKeys, MessageName, QueryName
from deltaph.telemetry.messages import layout, schema_document
from deltaph.telemetry.session import open_cell_session

_PER_FRAME: tuple[MessageName, ...] = ("setpoint", "actual", "timing")
_JSON = zenoh.Encoding.APPLICATION_JSON


class Publisher:
    """A sink that publishes a cell: its messages, its liveliness token and its queryables.

    The sequence number of `setpoint`, `actual` and `timing` is the frame's step, so that a frame that never came here is a gap there.

    Attributes:
        endpoints: where it listens.
        published: frames published so far.

    Args:
        cell: name of the cell.
        scenario_json: what the queryable `scenario` answers.
        listen: endpoints that are asked for; see `open_cell_session`.
        connect: endpoints to connect to as well.

    Raises:
        ValueError: the cell's name does not fit into a key.
        EnvironmentProblem: an endpoint that was asked for is in use, or is none.
    """

    def __init__(self, cell: str, scenario_json: str, *, listen: Sequence[str] = (), connect: Sequence[str] = ()) -> None:
        self.published = 0
        self._keys = CellKeys(cell)
        self._layouts = [(layout(name), name) for name in _PER_FRAME]
        self._plan = layout("plan")
        self._decided = (0, 0)
        self._plans = 0
        plan_fields = [field.name for field in self._plan.fields]
        self._decisions = [plan_fields.index(name) - plan_fields.index("plan.status") for name in ("plan.count", "plan.refused")]
