"""Messages in order: laws over any order of arrival, doubles, losses, and what the publisher still keeps."""

from collections.abc import Iterator

from hypothesis import given
from hypothesis import strategies as st

from deltaph.telemetry.order import Order


class Publisher:
    """Keeps the newest messages it sent, and answers when it is told to."""

    def __init__(self, kept: int) -> None:
        self.sent = 0
        self.kept = kept
        self.asked: list[tuple[int | None, int | None]] = []
        self.order = Order(lambda first, last: self.asked.append((first, last)))
        self.passed_on: list[int] = []

    def send(self, *, arrives: bool = True) -> None:
        self.sent += 1
        if arrives:
            self.arrives(self.sent - 1)

    def arrives(self, number: int) -> None:
        self.collect(self.order.take(number, b"%d" % number))

    def answer(self) -> None:
        """One query; what is lost on the way back is asked for again."""
        first, last = self.asked.pop(0)
        for number in range(max(self.sent - self.kept, first or 0), self.sent if last is None else last + 1):
            self.arrives(number)
        self.collect(self.order.answered())

    def collect(self, payloads: Iterator[bytes]) -> None:
        self.passed_on += [int(payload) for payload in payloads]


def test_newcomer_gets_what_is_kept_and_then_what_comes() -> None:
    publisher = Publisher(kept=3)
    for _ in range(10):
        publisher.send(arrives=False)
    publisher.order.catch_up()
    publisher.send()
    assert publisher.passed_on == []  # the history comes before it
    publisher.answer()
    publisher.send()
    assert publisher.passed_on == [8, 9, 10, 11]
    assert not publisher.asked


def test_gap_is_asked_for_once_and_closed() -> None:
    publisher = Publisher(kept=100)
    publisher.order.catch_up()
    publisher.answer()
    publisher.send()
    publisher.answer()  # of a publisher nothing is known of, the first message may not be the first
    for _ in range(3):
        publisher.send(arrives=False)
    for _ in range(3):
        publisher.send()
    assert publisher.asked == [(1, 3)]
    assert publisher.passed_on == [0]
    publisher.answer()
    assert publisher.passed_on == list(range(7))


def test_what_is_no_longer_kept_is_given_up() -> None:
    publisher = Publisher(kept=2)
    publisher.send()
    publisher.answer()
    for _ in range(5):
        publisher.send(arrives=False)
    publisher.send()
    publisher.answer()
    publisher.answer()  # the query that brought 5 left a gap before it: asked again, in vain
    assert publisher.passed_on == [0, 5, 6]
    assert not publisher.asked


def test_rest_is_what_was_held_back() -> None:
    publisher = Publisher(kept=0)
    publisher.send()
    publisher.answer()
    publisher.send(arrives=False)
    publisher.send()
    assert publisher.passed_on == [0]
    publisher.collect(publisher.order.rest())
    assert publisher.passed_on == [0, 2]


@given(
    arrivals=st.lists(st.integers(0, 40), max_size=80),
    events=st.lists(st.booleans(), max_size=80),
    kept=st.integers(0, 41),
)
def test_nothing_comes_twice_or_out_of_order_and_nothing_that_is_kept_is_lost(
    arrivals: list[int], events: list[bool], kept: int
) -> None:
    publisher = Publisher(kept)
    publisher.sent = 41
    publisher.order.catch_up()
    for number, answer in zip(arrivals, events, strict=False):
        publisher.arrives(number)
        if answer and publisher.asked:
            publisher.answer()
    publisher.arrives(40)
    while publisher.asked:
        publisher.answer()
    publisher.collect(publisher.order.rest())
    assert publisher.passed_on == sorted(set(publisher.passed_on))
    assert publisher.passed_on[-1] == 40
    assert set(range(41 - kept, 41)) <= set(publisher.passed_on)
