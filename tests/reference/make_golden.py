"""Write the golden files: `python tests/reference/make_golden.py [case ...]`, all without arguments."""

import importlib
import sys
import time
from pathlib import Path


def main() -> None:
    """Compute and write the golden files named on the command line, progress on stderr."""
    sys.path.insert(0, str(Path(__file__).parents[1]))
    golden = importlib.import_module("reference.golden")
    corner = importlib.import_module("reference.golden_corner")
    mechanism = importlib.import_module("reference.golden_mechanism")
    cases = golden.load("cases.toml")
    robot = golden.robot(cases)
    names = sys.argv[1:] or [*cases["case"], "corners", "mechanism"]
    for name in names:
        begin = time.monotonic()
        if name == "mechanism":
            rows = list(mechanism.mechanism_rows(golden.load("mechanism.toml"), robot))
        elif name == "corners":
            rows = list(corner.corner_rows(golden.load("corners.toml")))
        else:
            rows = list(golden.plan_rows(name, cases["case"][name], robot))
        golden.write(golden.FOLDER / f"{name}.csv", rows)
        print(f"{name}: {len(rows)} numbers in {time.monotonic() - begin:.1f} s", file=sys.stderr)


if __name__ == "__main__":
    main()
