"""``acquire doctor`` finds foreign files, missing libraries, ports that are shut, threads."""

from __future__ import annotations

import os
from importlib import metadata
from pathlib import Path

import pytest

from acquire import doctor


def installed(folder: Path, name: str, *files: str) -> metadata.Distribution:
    """A distribution that has installed some files."""
    info = folder / f"{name}-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
    (info / "RECORD").write_text("".join(f"{f},,\n" for f in files))
    return metadata.Distribution.at(info)


def test_another_s_files_in_our_packages_are_a_fault(tmp_path: Path) -> None:
    ours = installed(tmp_path, "skinrig", "acquire/__init__.py", "gap/__init__.py")
    harmless = installed(tmp_path, "numpy", "numpy/__init__.py")
    assert [c.level for c in doctor.packages([ours, harmless])] == ["ok"]
    theirs = installed(tmp_path, "acquire", "acquire/__init__.py", "acquire/collector.py")
    (found,) = doctor.packages([ours, harmless, theirs])
    assert found.level == "fault"
    assert "acquire has 2 files in our packages" in found.found
    assert "acquire/__init__.py, are ours too" in found.found
    assert "pipx" in found.remedy


def test_a_missing_library_is_named_with_its_remedy() -> None:
    assert doctor.usb(lambda name: "libusb-1.0.so.0")[0].level == "ok"
    (found,) = doctor.usb(lambda name: None)
    assert found.level == "warning"
    assert "libusb" in found.remedy


@pytest.mark.skipif(os.name != "posix" or os.geteuid() == 0, reason="who may do everything sees no shut port")
def test_a_port_that_is_shut_is_a_fault(tmp_path: Path) -> None:
    port = tmp_path / "ttyUSB0"
    port.touch(mode=0o000)
    (found,) = doctor.serial_ports([str(port)])
    assert (found.level, "dialout" in found.remedy) == ("fault", True)


def test_no_port_is_no_fault() -> None:
    assert [c.level for c in doctor.serial_ports([])] == ["ok"]


def test_threads_are_told_by_the_environment() -> None:
    assert doctor.threads(dict.fromkeys(doctor.THREADS, "1"))[0].level == "ok"
    (found,) = doctor.threads({"OMP_NUM_THREADS": "1"})
    assert found.remedy == "export OPENBLAS_NUM_THREADS=1 MKL_NUM_THREADS=1"
