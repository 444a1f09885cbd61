"""Writes `fmu_src/<fmu>/reference.csv`, the expected results that travel in the FMUs, from the FMUs of this checkout.

    python tests/make_reference.py

To be run after a change that means to change them; `test_fmu_content.py` holds them otherwise.
"""

import tempfile
from pathlib import Path

from fmpy import simulate_fmu

from deltaph.fmu import build
from deltaph.fmu.package import file_name
from deltaph.sources import FMU_SRC
from deltaph.variables import MODELS, variable_table

EVERY = 10
"""Milliseconds between rows."""


def main() -> None:
    """Write both files."""
    for model in MODELS:
        (FMU_SRC / model / "reference.csv").touch()
    with tempfile.TemporaryDirectory() as directory:
        build(Path(directory), [3])
        for model in MODELS:
            names = [v.name for v in variable_table(model).of("output")]
            fmu = Path(directory) / file_name(model, 3)
            result = simulate_fmu(str(fmu), output=names, step_size=1e-3, output_interval=1e-3)
            lines = [",".join(f'"{name}"' for name in ["time", *names])]
            rows = zip(*(result[name][::EVERY].tolist() for name in ["time", *names]), strict=True)
            lines += [",".join(f"{value if abs(value) > 1e-9 else 0:.9g}" for value in row) for row in rows]
            (FMU_SRC / model / "reference.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
