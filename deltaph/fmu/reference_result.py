"""The expected result that travels in an FMU (FMI-LS-REF): what the default experiment gives, every 10 ms."""

from __future__ import annotations

from deltaph.sources import FMU_SRC
from deltaph.variables import Model, variable_table

_FOLDER = "extra/org.fmi-standard.fmi-ls-ref"


def reference_result(model: Model) -> dict[str, bytes]:
    """Path in the FMU -> content. The values are those of `fmu_src/<fmu>/reference.csv`."""
    name = f"{variable_table(model).model}_out.csv"
    manifest = f"""<?xml version="1.0" encoding="UTF-8"?>
<fmiReferences
    xmlns:fmi-ls="http://fmi-standard.org/fmi-ls-manifest"
    fmi-ls:fmi-ls-name="org.fmi-standard.fmi-ls-ref"
    fmi-ls:fmi-ls-version="1.0.0-alpha.1"
    fmi-ls:fmi-ls-description="Expected results">
    <Related type="text/csv" source="{name}" role="result" description="Output of the default experiment"/>
</fmiReferences>
"""
    return {
        f"{_FOLDER}/fmi-ls-manifest.xml": manifest.encode(),
        f"{_FOLDER}/{name}": (FMU_SRC / model / "reference.csv").read_bytes(),
    }
