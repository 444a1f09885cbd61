"""The FMUs: generated from the variable tables, compiled from `fmu_src`, packed for any importer."""

from deltaph.fmu.product import FMI_VERSIONS, build, cached_fmus

__all__ = ["FMI_VERSIONS", "build", "cached_fmus"]
