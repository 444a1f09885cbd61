"""Archives."""

import io
import zipfile

from deltaph.fmu.package import archive


def test_equal_content_gives_equal_bytes() -> None:
    assert archive({"b": b"2", "a/c": b"1"}) == archive({"a/c": b"1", "b": b"2"})


def test_archive_is_sorted_and_restores_its_content() -> None:
    with zipfile.ZipFile(io.BytesIO(archive({"b": b"2", "a/c": b"1" * 1000}))) as container:
        assert container.namelist() == ["a/c", "b"]
        assert container.read("a/c") == b"1" * 1000
        assert container.testzip() is None
        assert max(entry.extract_version for entry in container.infolist()) <= 20
