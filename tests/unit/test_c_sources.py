"""All C compiles without a warning under strict flags."""

import shutil
import subprocess
from pathlib import Path

import pytest

from deltaph.fmu.c_table import write_c_table
from deltaph.fmu.compile import fmi_headers
from deltaph.sources import FMU_SRC
from deltaph.variables import MODELS, Model

STRICT = "-std=c99 -O2 -ffp-contract=off -Wall -Wextra -Wpedantic -Wconversion -Wshadow -Werror -fsyntax-only".split()


@pytest.mark.parametrize("model", MODELS)
def test_c_has_no_warnings(model: Model, tmp_path: Path) -> None:
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None:
        pytest.skip("there is no C compiler")
    write_c_table(model, tmp_path)
    sources = [p for folder in ("kernel", "fmi", model) for p in sorted((FMU_SRC / folder).glob("*.c"))] + sorted(tmp_path.glob("*.c"))
    assert len(sources) > 10
    includes = [f"-I{folder}" for folder in (FMU_SRC, FMU_SRC / "fmi", FMU_SRC / model, tmp_path, fmi_headers())]
    result = subprocess.run([compiler, *STRICT, *includes, *map(str, sources)], capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr
