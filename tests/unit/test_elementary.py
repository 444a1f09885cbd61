"""The elementary functions of the source FMUs against high precision."""

import ctypes
import math
import random
import subprocess
from collections.abc import Callable

import mpmath
import pytest

from deltaph.errors import EnvironmentProblem
from deltaph.fmu.compile import compiler
from deltaph.fmu.sources import ELEMENTARY

UNARY = ("sin", "cos", "exp", "expm1", "tanh", "log", "sqrt", "cbrt", "floor", "ceil", "round")
BINARY = ("atan2", "hypot", "pow", "fmin", "fmax", "copysign")


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> ctypes.CDLL:
    """The functions, exported as t_sin and so on, linked without libm."""
    try:
        command = compiler()
    except EnvironmentProblem as reason:
        pytest.skip(str(reason))
    folder = tmp_path_factory.mktemp("elementary")
    lines = [f'#include "{ELEMENTARY}"']
    lines += [f"double t_{name}(double x) {{ return {name}(x); }}" for name in UNARY]
    lines += [f"double t_{name}(double x, double y) {{ return {name}(x, y); }}" for name in BINARY]
    (folder / "t.c").write_text("\n".join(lines) + "\n")
    flags = [
        "-std=c99",
        "-O2",
        "-ffp-contract=off",
        "-fPIC",
        "-shared",
        "-Wall",
        "-Wextra",
        "-Wpedantic",
        "-Wconversion",
        "-Werror",
    ]
    subprocess.run([*command, *flags, "t.c", "-o", "t.so", "-Wl,--no-undefined"], cwd=folder, check=True)
    return ctypes.CDLL(str(folder / "t.so"))


def function(library: ctypes.CDLL, name: str) -> Callable[..., float]:
    found = getattr(library, f"t_{name}")
    found.restype = ctypes.c_double
    found.argtypes = [ctypes.c_double] * (1 if name in UNARY else 2)
    return found  # type: ignore[no-any-return]


def units(found: float, true: mpmath.mpf) -> float:
    """Distance in units in the last place."""
    return 0.0 if found == float(true) else float(abs(mpmath.mpf(found) - true) / math.ulp(float(true)))


uniform = random.Random(1).uniform

CASES = [
    ("sin", 1.0, lambda: (uniform(-10.0, 10.0),)),
    ("sin", 1.0, lambda: (uniform(-1e9, 1e9),)),
    ("sin", 1.0, lambda: (round(uniform(1, 1000)) * math.pi,)),
    ("cos", 1.0, lambda: (uniform(-10.0, 10.0),)),
    ("cos", 1.0, lambda: ((round(uniform(1, 1000)) + 0.5) * math.pi,)),
    ("exp", 1.5, lambda: (uniform(-5.0, 5.0),)),
    ("exp", 1.5, lambda: (uniform(-700.0, 700.0),)),
    ("expm1", 4.0, lambda: (uniform(-5.0, 5.0),)),
    ("expm1", 4.0, lambda: (-(10.0 ** uniform(-12.0, 0.0)),)),
    ("tanh", 4.0, lambda: (uniform(-3.0, 3.0),)),
    ("tanh", 4.0, lambda: (10.0 ** uniform(-12.0, 0.0),)),
    ("log", 1.5, lambda: (10.0 ** uniform(-300.0, 300.0),)),
    ("log", 1.5, lambda: (uniform(0.5, 2.0),)),
    ("sqrt", 0.0, lambda: (10.0 ** uniform(-300.0, 300.0),)),
    ("cbrt", 1.0, lambda: (10.0 ** uniform(-300.0, 300.0),)),
    ("atan2", 2.0, lambda: (uniform(-1.0, 1.0), uniform(-1.0, 1.0))),
    ("atan2", 2.0, lambda: (10.0 ** uniform(-150.0, 150.0), 10.0 ** uniform(-150.0, 150.0))),
    ("hypot", 2.5, lambda: (uniform(-1.0, 1.0), 10.0 ** uniform(-5.0, 5.0))),
    ("pow", 10.0, lambda: (10.0 ** uniform(-3.0, 3.0), 2.0 / 3.0)),
]


@pytest.mark.parametrize(("name", "bound", "draw"), CASES, ids=lambda value: value if isinstance(value, str) else "")
def test_within_units_in_the_last_place(
    library: ctypes.CDLL, name: str, bound: float, draw: Callable[[], tuple[float, ...]]
) -> None:
    call, reference = function(library, name), getattr(mpmath, {"pow": "power", "log": "log"}.get(name, name))
    with mpmath.workdps(40):
        for _ in range(2000):
            arguments = draw()
            assert units(call(*arguments), reference(*map(mpmath.mpf, arguments))) <= bound, arguments


def test_whole_numbers(library: ctypes.CDLL) -> None:
    for x in (2.5, -2.5, 0.5, -0.5, 1e20, 0.49999999999999994, -0.2, 3.7, -3.7, 0.0, 4503599627370497.5):
        assert function(library, "floor")(x) == math.floor(x)
        assert function(library, "ceil")(x) == math.ceil(x)
        assert function(library, "round")(x) == math.copysign(math.floor(abs(x) + 0.5) if x != 0.49999999999999994 else 0.0, x)


def test_ends_of_the_range(library: ctypes.CDLL) -> None:
    inf, nan = math.inf, math.nan
    for y in (0.0, -0.0, 1.0, -1.0, inf, -inf, 5e-324, 1e308):
        for x in (0.0, -0.0, 1.0, -1.0, inf, -inf, 5e-324, 1e308):
            assert function(library, "atan2")(y, x) == math.atan2(y, x), (y, x)
            assert function(library, "hypot")(y, x) == pytest.approx(math.hypot(y, x), rel=1e-15)
            assert function(library, "copysign")(y, x) == math.copysign(y, x)
    assert [function(library, "exp")(x) for x in (inf, -inf, 1000.0, -1000.0)] == [inf, 0.0, inf, 0.0]
    assert [function(library, "tanh")(x) for x in (inf, -inf, 30.0)] == [1.0, -1.0, 1.0]
    assert [function(library, "sqrt")(x) for x in (0.0, inf)] == [0.0, inf]
    assert [function(library, "fmin")(*xy) for xy in ((nan, 1.0), (1.0, nan), (2.0, 1.0))] == [1.0, 1.0, 1.0]
    assert [function(library, "fmax")(*xy) for xy in ((nan, 1.0), (1.0, nan), (2.0, 1.0))] == [1.0, 1.0, 2.0]
    for name in ("sin", "cos", "exp", "tanh", "log", "sqrt", "floor"):
        assert math.isnan(function(library, name)(nan))
    for name, x in (("sin", inf), ("cos", -inf), ("log", -1.0), ("sqrt", -1.0)):
        assert math.isnan(function(library, name)(x))
