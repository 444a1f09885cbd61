"""What is wrong with a scenario file, in one sentence."""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from typing import Any, get_args

from pydantic import BaseModel

from deltaph.scenario_file import ScenarioFile


def _known_keys(location: Sequence[str | int]) -> list[str]:
    """The keys that a table of the file may have."""
    model: type[BaseModel] = ScenarioFile
    for part in location:
        if isinstance(part, int):
            continue  # one of several tables
        field = next((f for name, f in model.model_fields.items() if part in {name, f.alias}), None)
        if field is None:
            return []
        inner = [t for t in (field.annotation, *get_args(field.annotation)) if isinstance(t, type) and issubclass(t, BaseModel)]
        if not inner:
            return []
        model = inner[0]
    return [field.alias or name for name, field in model.model_fields.items()]


def sentence(error: Mapping[str, Any]) -> str:
    """One of pydantic's errors as a sentence that names the key, the value and the way out."""
    location = [part for part in error["loc"] if not (isinstance(part, str) and part.startswith(("float", "tuple", "constrained")))]
    if location[:2] == ["sequence", "parts"] and len(location) > 2:
        return f"part {location[2] + 1} of the sequence: {_about(error, location, location[3:])}"
    return _about(error, location, location)


def _about(error: Mapping[str, Any], location: Sequence[str | int], shown: Sequence[str | int]) -> str:
    """The sentence, with the part of the location that is not said yet."""
    key = ".".join(str(part) for part in shown)
    match error["type"]:
        case "extra_forbidden":
            known = _known_keys(location[:-1])
            near = difflib.get_close_matches(str(location[-1]), known, n=1, cutoff=0.5)
            return f"unknown key {key}: " + (f"did you mean {near[0]}?" if near else f"known are {', '.join(known)}")
        case "missing":
            return f"key {key} is missing"
        case "value_error":
            return (f"{key}: " if key else "") + str(error["msg"]).removeprefix("Value error, ")
        case _:
            message = error["msg"][0].lower() + error["msg"][1:]
            return f"{key} is {error['input']!r}: {message}"
