"""Dependencies run one way: kernel < FMI models; errors < scenario < plan < importer; telemetry sees frames and tables only."""

import ast
import re
from pathlib import Path

ROOT = Path(__file__).parents[2]

ORDER = [
    {"errors", "sources", "files"},
    {"variables"},
    {"frame", "kernel", "scenario_file"},
    {"complaints"},
    {"robot", "fmu"},
    {"scenario"},
    {"plan", "feed"},
    {"schedule"},
    {"slave", "outputs", "plot", "pacing"},
    {"importer"},
    {"execution"},
    {"checks"},
    {"report", "scene"},
    {"verdict"},
    {"tally", "recorder", "sinks"},
    {"attendant"},
    {"desk"},
    {"run", "record", "bench", "claims", "compare", "export", "soak_peer"},
    {"cost"},
    {"paper", "serve", "soak", "view"},
    {"cli"},
    {"__main__"},
]
KNOW_TELEMETRY = {"scene", "recorder", "sinks", "attendant", "desk", "run", "record", "compare", "export", "paper", "serve"}
KNOW_TELEMETRY |= {"soak_peer", "soak", "view", "cli"}
TELEMETRY_SEES = {"errors", "frame", "variables"}


def imports(path: Path) -> set[str]:
    """Modules of deltaph that a file imports, wherever in the file."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module and node.module.split(".")[0] == "deltaph":
            parts = node.module.split(".")[1:]
            found |= {parts[0]} if parts else {alias.name for alias in node.names}
        elif isinstance(node, ast.Import):
            found |= {name.split(".")[1] for name in (a.name for a in node.names) if name.startswith("deltaph.")}
    return found


def test_python_layers() -> None:
    level = {module: i for i, modules in enumerate(ORDER) for module in modules}
    files = [p for p in (ROOT / "deltaph").rglob("*.py") if p.name != "__init__.py" or p.parent.name != "deltaph"]
    assert files
    for path in files:
        module = path.relative_to(ROOT / "deltaph").parts[0].removesuffix(".py")
        for imported in imports(path) - {module, "telemetry"}:
            assert level[imported] <= level[module], f"{path.name} imports {imported}, which is above it"
        if module not in KNOW_TELEMETRY:
            assert "telemetry" not in imports(path), f"{path.name} knows telemetry"


def test_nothing_imports_the_command_line() -> None:
    for path in (*(ROOT / "deltaph").rglob("*.py"), *(ROOT / "telemetry").rglob("*.py")):
        of_it = path.name == "__main__.py" or path.parent.name == "cli"
        assert of_it or "cli" not in imports(path), path


def test_telemetry_sees_frames_and_tables_only() -> None:
    files = list((ROOT / "telemetry").rglob("*.py"))
    assert files
    for path in files:
        assert imports(path) - {"telemetry"} <= TELEMETRY_SEES, path


def test_reference_never_imports_the_product() -> None:
    files = list((ROOT / "tests" / "reference").glob("*.py"))
    assert files
    for path in files:
        assert not imports(path), path


def test_kernel_knows_nothing_of_fmi_and_does_no_input_or_output() -> None:
    for path in (*(ROOT / "fmu_src/kernel").glob("*.c"), *(ROOT / "fmu_src/kernel").glob("*.h")):
        text = path.read_text(encoding="utf-8")
        for include in re.findall(r'#include [<"]([^>"]+)[>"]', text):
            assert "fmi" not in include and "model" not in include, path
            assert include != "stdio.h" or path.name == "verdict.c", path
        assert not re.search(r"\b(malloc|calloc|realloc|free|printf|fprintf|fopen|time|clock)\s*\(", text), path


def test_adapters_know_nothing_of_robots() -> None:
    for path in (ROOT / "fmu_src/fmi").glob("*"):
        text = path.read_text(encoding="utf-8").lower()
        assert "kernel" not in text, path
        assert not re.search(r"\b(dph_|joint|gripper)", text), path
