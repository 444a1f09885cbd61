"""A million random calls of the C API under address and undefined-behaviour sanitizers, without a finding."""

from __future__ import annotations

import os
import re
import subprocess
from pathlib import Path

import pytest

from deltaph.errors import EnvironmentProblem
from deltaph.fmu import FMI_VERSIONS
from deltaph.fmu.compile import compiler, fmi_headers
from deltaph.fmu.model_description import FmiVersion
from deltaph.fmu.translation_unit import translation_unit
from deltaph.variables import MODELS, Model

CALLS = int(os.environ.get("DELTAPH_FUZZ_CALLS", "1000000")) // (len(MODELS) * len(FMI_VERSIONS))
SANITIZERS = "-fsanitize=address,undefined,float-cast-overflow"


@pytest.mark.parametrize("version", FMI_VERSIONS)
@pytest.mark.parametrize("model", MODELS)
def test_random_calls_do_no_harm(model: Model, version: FmiVersion, tmp_path: Path) -> None:
    try:
        command = compiler()
    except EnvironmentProblem as reason:
        pytest.skip(str(reason))
    (tmp_path / "unit.c").write_bytes(translation_unit(model, version))
    source = str(Path(__file__).with_name("fuzz.c"))
    options = ["-std=c99", "-g", "-O1", "-Wall", "-Wextra", "-Werror", SANITIZERS, "-fno-sanitize-recover=all"]
    definitions = [f"-DVERSION={version}", '-DUNIT="unit.c"', "-I", str(tmp_path), "-isystem", str(fmi_headers())]
    program = str(tmp_path / "fuzz")
    build = subprocess.run([*command, *options, *definitions, source, "-o", program], capture_output=True, text=True, check=False)
    if build.returncode != 0 and re.search(r"asan|ubsan", build.stderr):
        pytest.skip("the compiler has no sanitizers")
    assert build.returncode == 0, build.stderr
    run = subprocess.run([program, str(CALLS), "1"], capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr[-5000:]
    calls, steps, fine, discarded, errors, logged = map(int, re.findall(r"\d+", run.stdout))
    assert calls >= CALLS
    # Otherwise it would not have been where the code is.
    assert min(steps, fine - steps, errors) > CALLS / 20
    assert discarded > CALLS / 200
    assert logged > 0
