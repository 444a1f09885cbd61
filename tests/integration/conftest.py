"""The FMUs, built once."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from integration.fmi_slave import FmiSlave

from deltaph.fmu import FMI_VERSIONS, build
from deltaph.fmu.model_description import FmiVersion
from deltaph.variables import MODELS, Model


@pytest.fixture(scope="session")
def dist(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A directory with everything `build` makes."""
    directory = tmp_path_factory.mktemp("build") / "dist"
    build(directory)
    return directory


@pytest.fixture(params=MODELS)
def model(request: pytest.FixtureRequest) -> Model:
    """Each model."""
    return request.param  # type: ignore[no-any-return]


@pytest.fixture(params=FMI_VERSIONS, ids=lambda version: f"fmi{version}")
def version(request: pytest.FixtureRequest) -> FmiVersion:
    """Each version of the FMI."""
    return request.param  # type: ignore[no-any-return]


@pytest.fixture
def new_slave(dist: Path, model: Model, version: FmiVersion, tmp_path: Path) -> Iterator[Callable[..., FmiSlave]]:
    """Makes instances of one FMU, and frees them."""
    slaves: list[FmiSlave] = []

    def make(name: str = "one", *, logging: bool = True) -> FmiSlave:
        slaves.append(FmiSlave(dist, model, version, tmp_path, name=name, logging=logging))
        return slaves[-1]

    yield make
    for slave in slaves:
        slave.free()


@pytest.fixture
def slave(new_slave: Callable[..., FmiSlave]) -> FmiSlave:
    """An instance, just instantiated."""
    return new_slave()


@pytest.fixture
def running(slave: FmiSlave) -> FmiSlave:
    """An instance in step mode at time 0."""
    slave.initialize()
    return slave


@pytest.fixture
def new_plant(dist: Path, version: FmiVersion, tmp_path: Path) -> Iterator[Callable[[], FmiSlave]]:
    """Makes instances of the plant, and frees them."""
    plants: list[FmiSlave] = []

    def make() -> FmiSlave:
        plants.append(FmiSlave(dist, "plant", version, tmp_path))
        return plants[-1]

    yield make
    for plant in plants:
        plant.free()


@pytest.fixture
def plant(new_plant: Callable[[], FmiSlave]) -> FmiSlave:
    """An instance of the plant."""
    return new_plant()
