"""FMUs as zip files, byte for byte the same from the same content."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Mapping

from deltaph.fmu.compile import shared_library
from deltaph.fmu.documentation import index_html, license_text
from deltaph.fmu.host import host
from deltaph.fmu.model_description import FmiVersion, model_description
from deltaph.fmu.sources import token
from deltaph.variables import Model, variable_table


def archive(files: Mapping[str, bytes]) -> bytes:
    """A zip file of these names and contents: sorted, the same date and rights for all."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as container:
        for name, content in sorted(files.items()):
            entry = zipfile.ZipInfo(name, date_time=(1980, 1, 1, 0, 0, 0))
            entry.compress_type = zipfile.ZIP_DEFLATED
            entry.create_system = 3  # Unix, whatever this runs on
            entry.external_attr = 0o100644 << 16
            container.writestr(entry, content)
    return buffer.getvalue()


def file_name(model: Model, version: FmiVersion) -> str:
    """The name of an FMU's file."""
    return f"{variable_table(model).model}{'-fmi2' if version == 2 else ''}.fmu"


def fmu(model: Model, version: FmiVersion) -> bytes:
    """An FMU for this machine, compiled now.

    Raises:
        EnvironmentProblem: it cannot be compiled.
    """
    table = variable_table(model)
    platform = host()
    files = {
        "modelDescription.xml": model_description(table, version, token(model, version)),
        f"binaries/{platform.folder(version)}/{table.model}{platform.extension}": shared_library(model, version),
        "documentation/index.html": index_html(table),
    }
    licence = license_text()
    if licence is not None:
        files["documentation/licenses/license.txt"] = licence
    return archive(files)
