"""Puts the messages of one publisher in the order they were sent in, whatever comes twice, late, or has to be sent again."""

from __future__ import annotations

from collections.abc import Callable, Iterator

Ask = Callable[[int | None, int | None], None]
"""Asks for what was sent: from one number to another, inclusive; from None: as far back as it is kept; to None: to the newest."""


class Order:
    """Holds back what came too early until the gap before it is closed, or nobody can close it.

    Every `Ask` is answered by `take` for each message that is still kept, and then by `answered`.

    Args:
        ask: how to ask the publisher again.
    """

    def __init__(self, ask: Ask) -> None:
        self._ask_publisher = ask
        self._next: int | None = None  # to be passed on; None before the first one
        self._early: dict[int, bytes] = {}
        self._asked: tuple[int | None, int | None] | None = None  # what was known of the gap when it was asked for

    def catch_up(self) -> None:
        """The publisher is there, or there again: ask for what it has sent so far."""
        if self._asked is None:
            self._ask(None)

    def take(self, number: int, payload: bytes) -> Iterator[bytes]:
        """A message has come, by itself or because it was asked for; yields what can be passed on."""
        if self._next is not None and number < self._next:
            return
        self._early.setdefault(number, payload)
        yield from self._in_order()

    def answered(self) -> Iterator[bytes]:
        """All that was asked for and is still kept has come; yields what can be passed on."""
        if self._asked is None:
            return
        fruitless = self._asked == (self._next, self._gap_end())
        self._asked = None
        if self._early and (self._next is None or fruitless):
            self._next = min(self._early)  # nobody has what was before it
        yield from self._in_order()

    def rest(self) -> Iterator[bytes]:
        """Nothing more will come; yields what was held back."""
        early, self._early = sorted(self._early.items()), {}
        for number, payload in early:
            self._next = number + 1
            yield payload

    def _in_order(self) -> Iterator[bytes]:
        if self._next is not None:
            while (payload := self._early.pop(self._next, None)) is not None:
                self._next += 1
                yield payload
        if self._early and self._asked is None:
            self._ask(self._gap_end())

    def _gap_end(self) -> int | None:
        """Number of the last message that is missing before one that is here."""
        return min(self._early) - 1 if self._early else None

    def _ask(self, last: int | None) -> None:
        self._asked = self._next, self._gap_end()
        self._ask_publisher(self._next, last if self._next is not None else None)
