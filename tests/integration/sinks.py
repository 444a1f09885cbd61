"""Sinks for other processes, which import them from here."""

import os
from pathlib import Path

from integration.synthetic_cell import scene
from integration.waiting import wait_until

from deltaph.errors import EnvironmentProblem
from deltaph.frame import Frame
from deltaph.telemetry import Recorder


class ListSink:
    """Keeps every frame."""

    def __init__(self) -> None:
        self.frames: list[Frame] = []

    def take(self, frame: Frame) -> None:
        self.frames.append(frame)

    def close(self) -> None:
        pass


class Steps(ListSink):
    """Knows its frames, where it is, and writes a file when it is closed."""

    def __init__(self, closed: Path | None = None) -> None:
        super().__init__()
        self._closed = closed

    def steps(self) -> list[int]:
        return [frame.step for frame in self.frames]

    def pid(self) -> int:
        return os.getpid()

    def refuse(self) -> None:
        raise EnvironmentProblem("not that")

    def close(self) -> None:
        if self._closed is not None:
            self._closed.write_text(str(len(self.frames)), encoding="ascii")


class Gate(Steps):
    """Takes frames when a file is there, and says in another that it waits."""

    def __init__(self, directory: Path) -> None:
        super().__init__()
        self._directory = directory

    def take(self, frame: Frame) -> None:
        (self._directory / "waiting").touch()
        wait_until((self._directory / "open").exists)
        super().take(frame)


class Broken(Steps):
    """Fails at the third frame."""

    def take(self, frame: Frame) -> None:
        if frame.step == 2:
            raise EnvironmentProblem("the disk is full")
        super().take(frame)


def none_of_it() -> ListSink:
    raise EnvironmentProblem("it cannot be opened")


def recorder_of_the_scene(path: Path) -> Recorder:
    return Recorder(path, scene(), chunk=10)
