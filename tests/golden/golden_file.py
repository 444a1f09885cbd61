"""Golden values: one number, its tolerance and its provenance on a line, made by `python tests/reference/make_golden.py`."""

import csv
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

FOLDER = Path(__file__).parent


@dataclass(frozen=True)
class Golden:
    case: str
    quantity: str
    value: float
    tolerance: float
    absolute: float
    provenance: str

    def check(self, found: float) -> str | None:
        """What is wrong, or None."""
        bound = self.absolute + self.tolerance * abs(self.value)
        if abs(found - self.value) <= bound:
            return None
        return f"{self.case} {self.quantity}: {found!r}, expected {self.value!r} within {bound:.2g} ({self.provenance})"


def golden(name: str) -> list[Golden]:
    with (FOLDER / f"{name}.csv").open(encoding="utf-8") as stream:
        return [
            Golden(
                row["case"],
                row["quantity"],
                float(row["value"]),
                float(row["tolerance"]),
                float(row["absolute"]),
                row["provenance"],
            )
            for row in csv.DictReader(stream)
        ]


def cases(name: str, table: str) -> dict[str, Any]:
    with (FOLDER / f"{name}.toml").open("rb") as stream:
        return dict(tomllib.load(stream)[table])
