"""What is wrong with a scenario file, in one sentence."""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from typing import Any, get_args

from pydantic import BaseModel, ValidationError

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


def sentence(error: ValidationError) -> str:
    """What is wrong first, as a sentence that names the key, the value and the way out, and how much more there is."""
    errors = [one for one in error.errors() if not _is_of_another_branch(one)]
    # A misspelt key is reported as one unknown and one missing: the first of the two says more.
    errors.sort(key=lambda one: one["type"] != "extra_forbidden")
    more = f" (and {len(errors) - 1} more)" if len(errors) > 1 else ""
    return _sentence(errors[0]) + more


def _branch(part: str | int) -> str:
    """What pydantic adds to a location where a value may be a number or an array: which of the two."""
    kinds = ("float", "constrained-float", "tuple")
    return next((kind for kind in kinds if isinstance(part, str) and part.split("[")[0] == kind), "")


def _is_of_another_branch(error: Mapping[str, Any]) -> bool:
    """An array that is found to be no number, or the other way round, where it may be either."""
    branches = [kind for kind in map(_branch, error["loc"]) if kind]
    if not branches:
        return False
    return error["type"] == "tuple_type" if branches[-1] == "tuple" else isinstance(error["input"], list)


def _sentence(error: Mapping[str, Any]) -> str:
    location = [part for part in error["loc"] if not _branch(part)]
    if location[:2] == ["sequence", "parts"] and len(location) > 2:
        return f"part {location[2] + 1} of the sequence: {_about(error, location, location[3:])}"
    if location[:1] in (["feed"], ["fault"]) and len(location) > 1:
        return f"{location[0]} {location[1] + 1}: {_about(error, location, location[2:])}"
    return _about(error, location, location)


def _about(error: Mapping[str, Any], location: Sequence[str | int], shown: Sequence[str | int]) -> str:
    """The sentence, with the part of the location that is not said yet."""
    key = ".".join(str(part) for part in shown)
    value = f"{key or 'it'} is {error['input']!r}"
    match error["type"]:
        case "extra_forbidden":
            known = _known_keys(location[:-1])
            near = difflib.get_close_matches(str(location[-1]), known, n=1, cutoff=0.5)
            return f"unknown key {key}: " + (f"did you mean {near[0]}?" if near else f"known are {', '.join(known)}")
        case "missing" if isinstance(location[-1], int):
            return f"{'.'.join(map(str, shown[:-1]))} is {error['input']!r}: more values are needed"
        case "missing":
            return f"key {key} is missing"
        case "value_error":
            return (f"{key}: " if key else "") + str(error["msg"]).removeprefix("Value error, ")
        case "model_type":
            return f"{value}: a table is needed"
        case "tuple_type":
            return f"{value}: an array is needed"
        case "too_long":
            return f"{value}: at most {error['ctx']['max_length']} values are needed"
        case "too_short":
            return f"{value}: at least {error['ctx']['min_length']} is needed"
        case _:
            message = error["msg"][0].lower() + error["msg"][1:]
            return f"{value}: {message}"
