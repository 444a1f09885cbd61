"""`cell_host.c`, compiled and run: the cell in an importer that has no libm and is no Python."""

from __future__ import annotations

import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from integration.importers import STEPS, Table, reference, signals

from deltaph.fmu.compile import fmi_headers
from deltaph.fmu.sources import token
from deltaph.importer import CONNECTIONS
from deltaph.variables import MODELS, Model

HOST = Path(__file__).with_name("cell_host.c")


def compile_host(compiler: Sequence[str], program: Path) -> None:
    """Compile it; without libm."""
    command = [
        *compiler,
        "-std=c99",
        "-O1",
        "-Wall",
        "-Wextra",
        "-Werror",
        "-I",
        str(fmi_headers()),
        str(HOST),
        "-o",
        str(program),
        "-ldl",
    ]
    subprocess.run(command, check=True, capture_output=True, text=True)


def run_cell(command: Sequence[str], libraries: Mapping[Model, Path]) -> Table:
    """Run it with two FMI 3.0 libraries (STEPS, number of signals)."""
    lists = [[reference(model, name) for m, name in signals() if m == model] for model in MODELS]
    lists += [[reference("planner", output) for output, _ in CONNECTIONS], [reference("plant", name) for _, name in CONNECTIONS]]
    numbers = " ".join(str(number) for one in lists for number in (len(one), *one))
    arguments = [text for model in MODELS for text in (str(libraries[model]), token(model, 3))]
    run = subprocess.run([*command, *arguments, str(STEPS)], input=numbers, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    return np.array([[float.fromhex(value) for value in line.split()] for line in run.stdout.splitlines()])
