"""The C header: compiled, its structures are the bytes on the wire."""

import shutil
import subprocess
from pathlib import Path

import pytest
from integration.synthetic_cell import random_frame

from deltaph.telemetry import layout
from deltaph.telemetry.c_header import c_header
from deltaph.telemetry.events import event
from deltaph.telemetry.keys import MESSAGE_NAMES, MessageName

FORMATS = {"uint64": "%llu", "float64": "%.17g", "int32": "%d"}
CASTS = {"uint64": "(unsigned long long)", "float64": "", "int32": "(int)"}


@pytest.fixture(scope="module")
def reader(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A C program that prints the fields of a payload: NAME < payload."""
    folder = tmp_path_factory.mktemp("c")
    (folder / "deltaph_messages.h").write_text(c_header())
    branches = []
    for name in MESSAGE_NAMES:
        prints = "".join(f'        printf("{FORMATS[f.type]}\\n", {CASTS[f.type]}m.{f.word});\n' for f in layout(name).fields)
        branches.append(
            f'    if (strcmp(argv[1], "{name}") == 0) {{\n        deltaph_{name} m;\n'
            f"        if (size != DELTAPH_HEADER + DELTAPH_{name.upper()}_BYTES)\n            return 1;\n"
            f"        memcpy(&m, payload + DELTAPH_HEADER, DELTAPH_{name.upper()}_BYTES);\n{prints}    }}\n"
        )
    (folder / "reader.c").write_text(
        '#include <stdio.h>\n#include <string.h>\n#include "deltaph_messages.h"\n'
        "int main(int argc, char **argv)\n{\n    static char payload[65536];\n"
        "    size_t size = fread(payload, 1, sizeof payload, stdin);\n    (void)argc;\n" + "".join(branches) + "    return 0;\n}\n"
    )
    compiler = shutil.which("cc") or shutil.which("gcc")
    assert compiler
    command = [compiler, "-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "reader.c", "-o", "reader"]
    subprocess.run(command, cwd=folder, check=True)
    return folder / "reader"


@pytest.mark.parametrize("name", MESSAGE_NAMES)
def test_structures_are_the_bytes_on_the_wire(reader: Path, name: MessageName) -> None:
    message, frame = layout(name), random_frame(5)
    source = event(frame, "plan_refused", required=1.5, available=0.25, status=7, count=3) if name == "event" else frame
    payload = message.encode(source, sequence=2**40)
    printed = subprocess.run([reader, name], input=payload, capture_output=True, check=True).stdout.decode().split()
    assert [float(value) for value in printed] == [float(value) for value in message.as_dict(message.decode(payload)).values()]
    assert len(printed) == len(message.fields)
