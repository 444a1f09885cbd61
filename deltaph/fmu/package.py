"""FMUs as zip files, byte for byte the same from the same content."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Mapping

from deltaph.fmu.compile import shared_library
from deltaph.fmu.documentation import index_html, licenses
from deltaph.fmu.icon import icon
from deltaph.fmu.model_description import FmiVersion, model_description
from deltaph.fmu.platforms import chosen, host
from deltaph.fmu.reference_result import reference_result
from deltaph.fmu.source_fmu import sources
from deltaph.fmu.sources import token
from deltaph.fmu.terminals import terminals_and_icons
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


def binaries(model: Model, version: FmiVersion, platform: str) -> dict[str, bytes]:
    """Path in the FMU -> shared library, compiled now.

    Args:
        model: of which model.
        version: for which FMI version.
        platform: `host`, `all` or the name of one.

    Raises:
        DeltaphError: there is no such platform.
        EnvironmentProblem: one cannot be compiled.
    """
    targets = [(host(), None)] if platform == "host" else [(target, target) for target in chosen(platform, version)]
    identifier = variable_table(model).model
    return {
        f"binaries/{name.folder(version)}/{identifier}{name.extension}": shared_library(model, version, target)
        for name, target in targets
    }


def fmu(model: Model, version: FmiVersion, platform: str = "host") -> bytes:
    """An FMU: description, libraries, sources, documentation, icon, expected result.

    Raises:
        DeltaphError: there is no such platform.
        EnvironmentProblem: it cannot be compiled.
    """
    files = {"modelDescription.xml": model_description(variable_table(model), version, token(model, version))}
    files |= binaries(model, version, platform) | sources(model, version) | licenses() | reference_result(model)
    files["documentation/index.html"] = index_html(model)
    if version == 2:
        files["model.png"] = icon(model)
    else:
        files["terminalsAndIcons/icon.png"] = icon(model)
        files["terminalsAndIcons/terminalsAndIcons.xml"] = terminals_and_icons(model)
    return archive(files)
