"""Claims of the paper, held against measurements."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from rich.console import Console
from rich.table import Table


@dataclass(frozen=True, slots=True)
class Claim:
    """What the paper says, what is found, what to make of it, and what is found in a few words."""

    claim: str
    paper: str
    measured: str
    verdict: str
    brief: str


def print_claims(console: Console, claims: Sequence[dict[str, str]], title: str) -> None:
    """Claims, as dictionaries, as a table."""
    table = Table("claim", "the paper", "measured", "verdict", title=title, show_lines=True)
    for claim in claims:
        table.add_row(*(claim[column] for column in ("claim", "paper", "measured", "verdict")))
    console.print(table)
