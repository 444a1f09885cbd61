"""Where planning and sampling a PPO spend their time in the kernel: medians in microseconds, for each law of motion.

    python tests/bench/planning.py [ROUNDS] [--keep FOLDER]

Compiles planning.c and the kernel with the flags of the FMUs. With --keep the program stays in a folder, for a profiler:
`perf record FOLDER/planning 20000 0 sample`.
"""

import argparse
import subprocess
import tempfile
from pathlib import Path
from typing import Any

from deltaph.fmu.compile import FLAGS, compiler
from deltaph.kernel import enumeration, ffi
from deltaph.plan import Plan
from deltaph.scenario import parse_scenario, template
from deltaph.sources import FMU_SRC


def initializer(value: Any) -> str:
    """A C initializer of a number, an array or a structure of the kernel."""
    if isinstance(value, float):
        return f"{min(value, 1e30):.17g}"
    if isinstance(value, int | str):
        return str(int(value))
    kind = ffi.typeof(value)
    if kind.kind == "array":
        return "{" + ", ".join(initializer(item) for item in value) + "}"
    return "{" + ", ".join(f".{name} = {initializer(getattr(value, name))}" for name, _ in kind.fields) + "}"


def build(folder: Path) -> Path:
    """The program, with the paper's case."""
    plan = Plan.of(parse_scenario(template(), Path("paper.toml")))
    case = f"static const dph_robot robot = {initializer(plan.robot.struct[0])};\n"
    case += f"static dph_task task = {initializer(plan._struct.task)};\n"
    (folder / "case.h").write_text(case, encoding="utf-8")
    flags = [flag for flag in FLAGS if flag != "-shared"]
    sources = [Path(__file__).with_suffix(".c"), *sorted((FMU_SRC / "kernel").glob("*.c"))]
    include = [f"-I{folder}", f"-I{FMU_SRC / 'kernel'}"]
    program = folder / "planning"
    subprocess.run([*compiler(), *flags, "-g", *include, *map(str, sources), "-o", str(program), "-lm"], check=True)
    return program


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(description="Where planning and sampling a PPO spend their time in the kernel.")
    parser.add_argument("rounds", nargs="?", type=int, default=1000)
    parser.add_argument("--keep", type=Path)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="deltaph-") as temporary:
        folder = arguments.keep or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        program = build(folder)
        for law, name in enumerate(enumeration("dph_law")):
            rounds = arguments.rounds if name in {"paper", "comparison"} else max(arguments.rounds // 50, 1)
            output = subprocess.run([str(program), str(rounds), str(law)], check=True, capture_output=True, text=True).stdout
            print(f"{name:14s}", "  ".join(f"{line:>16s}" for line in output.split("\n") if line))


if __name__ == "__main__":
    main()
