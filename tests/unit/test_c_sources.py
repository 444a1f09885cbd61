"""All C compiles without a warning under strict flags."""

import subprocess
from pathlib import Path

import pytest

from deltaph.errors import EnvironmentProblem
from deltaph.fmu import FMI_VERSIONS, c_table
from deltaph.fmu.compile import compiler, fmi_headers
from deltaph.fmu.model_description import FmiVersion
from deltaph.fmu.sources import c_files
from deltaph.sources import FMU_SRC
from deltaph.variables import MODELS, Model, variable_table

STRICT = ("-std=c99", "-O2", "-ffp-contract=off", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wshadow", "-Werror")


@pytest.mark.parametrize("version", FMI_VERSIONS)
@pytest.mark.parametrize("model", MODELS)
def test_c_has_no_warnings(model: Model, version: FmiVersion, tmp_path: Path) -> None:
    try:
        command = compiler()
    except EnvironmentProblem as reason:
        pytest.skip(str(reason))
    table = variable_table(model)
    (tmp_path / c_table.HEADER).write_text(c_table.header(table), encoding="utf-8")
    (tmp_path / c_table.SOURCE).write_text(c_table.source(model, table, "token"), encoding="utf-8")
    sources = [*c_files(model, version), tmp_path / c_table.SOURCE]
    assert len(sources) > 10
    # Full compilation: some warnings need the optimizer. The FMI's own headers are not ours to keep free of them.
    arguments = [*command, *STRICT, "-c", f"-I{tmp_path}", f"-I{FMU_SRC}", "-isystem", str(fmi_headers()), *map(str, sources)]
    result = subprocess.run(arguments, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr
