"""The recording file: what is written reads back, opens on the right plot, and a hostile file is refused."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
from nexusformat.nexus import nxload

from acquire.recording import RecordingError, Series, open_recording, write_recording
from acquire.recording.model import difference
from tests.acquire.recording.samples import sample_recording


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_recording(sample_recording(), tmp_path_factory.mktemp("recording") / "run.h5")


def test_round_trip(written: Path) -> None:
    recording, read = sample_recording(), open_recording(written)
    assert difference(recording, read) == ""
    assert read.info.limits == recording.info.limits
    assert read.info.versions == recording.info.versions
    assert read.info.calibration["opening"] == recording.info.calibration["opening"]
    assert read.info.calibration["probe"] == recording.info.calibration["probe"]
    assert np.array_equal(read.info.calibration["matrix"]["value"], np.eye(3))
    assert read.streams["pressure"].range == (-5e4, 0.0)
    assert read.streams["pressure"].stage == "actuator"
    assert read.streams["pressure"].time is read.streams["apex_height"].time, "shared on disk, shared in memory"
    assert read.frames is not None
    assert recording.frames is not None
    assert np.array_equal(np.asarray(read.frames.data), recording.frames.data)
    assert np.array_equal(read.frames.data[2, 3:5], recording.frames.data[2, 3:5])
    assert np.array_equal(read.frames.data[-1], recording.frames.data[-1])
    assert not list(written.parent.glob("*.partial"))


def test_every_dataset_has_units_and_every_text_a_fixed_width(written: Path) -> None:
    def check(name: str, item: h5py.HLObject) -> None:
        if isinstance(item, h5py.Dataset):
            assert "units" in item.attrs, name
            assert not h5py.check_vlen_dtype(item.dtype), name

    with h5py.File(written) as file:
        file.visititems(check)
        assert file["entry/streams/pressure/value"].attrs["units"].decode() == "Pa"
        assert file["entry"].attrs["schema"].decode() == "acquire-recording/1"
        assert file["entry/streams/pressure/time"] == file["entry/streams/apex_height/time"]


def test_nexusformat_opens_on_the_default_plot(written: Path) -> None:
    root = nxload(written)
    assert root["entry/plot"].nxsignal.nxname == "apex_height"
    plottable = root.plottable_data
    assert plottable is not None
    assert plottable.nxpath == "/entry/plot"
    assert plottable.nxaxes[0].nxname == "time"
    assert str(root["entry/run/operator"]) == "ä"


def test_an_existing_file_is_left_alone(written: Path) -> None:
    before = written.read_bytes()
    with pytest.raises(RecordingError, match="exists already"):
        write_recording(sample_recording(), written)
    assert written.read_bytes() == before


def test_a_failed_write_leaves_no_file(tmp_path: Path) -> None:
    recording = sample_recording()
    bad = replace(recording, streams={"pressure": Series(np.ones(3), np.ones(4), "Pa")})
    with pytest.raises(RecordingError, match=r"pressure has \(3,\) values but time of \(4,\)"):
        write_recording(bad, tmp_path / "run.h5")
    with pytest.raises(RecordingError, match="cannot be the name of a stream"):
        write_recording(replace(recording, streams={"a/b": Series(np.ones(3), np.ones(3), "Pa")}), tmp_path / "run.h5")
    assert list(tmp_path.iterdir()) == []


def test_empty_recording(tmp_path: Path) -> None:
    empty = replace(sample_recording(frames=0), streams={}, setpoints={}, events=())
    assert difference(empty, open_recording(write_recording(empty, tmp_path / "run.h5"))) == ""
    no_sample = replace(empty, streams={"pressure": Series(np.empty(0), np.empty(0), "Pa")})
    assert len(open_recording(write_recording(no_sample, tmp_path / "run2.h5")).stream("pressure").value) == 0


def test_setpoints_with_times_of_their_own(tmp_path: Path) -> None:
    a = Series(np.array([0.0, 1.0]), np.array([0.0, 1.0]), "m")
    b = Series(np.array([0.0, 1.0, 2.0]), np.array([0.0, 1.0, 2.0]), "m")
    recording = replace(sample_recording(), setpoints={"probe_x": a, "probe_y": b})
    assert difference(recording, open_recording(write_recording(recording, tmp_path / "run.h5"))) == ""


def test_unknown_channel_is_named(written: Path) -> None:
    with pytest.raises(KeyError, match=r"no channel 'force_x'; it has pressure, apex_height"):
        open_recording(written).stream("force_x")


def test_a_damaged_frame_is_noticed(written: Path, tmp_path: Path) -> None:
    path = tmp_path / "run.h5"
    shutil.copy(written, path)
    with h5py.File(path, "r+") as file:
        file["entry/frames/data"][1, 0, 0] ^= 255
    frames = open_recording(path).frames
    assert frames is not None
    assert frames.data[0].shape == (24, 32)
    with pytest.raises(RecordingError, match="frame 1 does not match its CRC"):
        frames.data[1]


def _replace(file: h5py.File, name: str, make: Callable[[], object]) -> None:
    del file[name]
    make()


def _virtual(file: h5py.File) -> None:
    layout = h5py.VirtualLayout(shape=(10,), dtype="f8")
    layout[:] = h5py.VirtualSource("/etc/hostname", "x", shape=(10,))
    name = "entry/streams/pressure/value"
    _replace(file, name, lambda: file.create_virtual_dataset(name, layout))


def _vlen(file: h5py.File) -> None:
    name = "entry/run/subject"
    _replace(file, name, lambda: file.create_dataset(name, data="P07", dtype=h5py.string_dtype()))


def _external_storage(file: h5py.File) -> None:
    name = "entry/streams/pressure/value"
    external = [("/etc/hostname", 0, 80)]
    _replace(file, name, lambda: file.create_dataset(name, (10,), "f8", external=external))


def _bomb(file: h5py.File) -> None:
    name = "entry/streams/pressure/value"
    _replace(file, name, lambda: file.create_dataset(name, (10**13,), "f8", chunks=(2**20,), compression="gzip"))


def _link(file: h5py.File) -> None:
    file["entry/streams/spy"] = h5py.ExternalLink("/etc/other.h5", "/entry")


def _filter(file: h5py.File) -> None:
    name = "entry/streams/pressure/value"
    _replace(file, name, lambda: file.create_dataset(name, data=np.ones(3000), compression="lzf"))


def _schema(file: h5py.File) -> None:
    file["entry"].attrs["schema"] = "acquire-recording/9"


def _missing_time(file: h5py.File) -> None:
    del file["entry/streams/pressure/time"]


def _unequal(file: h5py.File) -> None:
    name = "entry/streams/pressure/seq"
    _replace(file, name, lambda: file.create_dataset(name, data=np.arange(7)))


def _no_run(file: h5py.File) -> None:
    del file["entry/run"]


def _events(file: h5py.File) -> None:
    _replace(file, "entry/events", lambda: file.create_dataset("entry/events", data=np.ones(3)))


HOSTILE = {
    "external link to '/etc/other.h5'": _link,
    "external file '/etc/hostname'": _external_storage,
    "value is a virtual dataset": _virtual,
    "variable-length": _vlen,
    "claims 80000000000000 bytes": _bomb,
    "needs the HDF5 filter": _filter,
    "expected 'acquire-recording/1'": _schema,
    "pressure/time is missing": _missing_time,
    "pressure/seq is of shape": _unequal,
    "/entry/run is missing": _no_run,
    "/entry/events": _events,
}


@pytest.mark.parametrize("message", HOSTILE)
def test_hostile_or_foreign_files_are_refused(written: Path, tmp_path: Path, message: str) -> None:
    path = tmp_path / "run.h5"
    shutil.copy(written, path)
    with h5py.File(path, "r+") as file:
        HOSTILE[message](file)
    with pytest.raises(RecordingError, match=message) as caught:
        open_recording(path)
    assert str(path) in str(caught.value)


def test_not_hdf5_and_truncated(written: Path, tmp_path: Path) -> None:
    path = tmp_path / "run.h5"
    path.write_bytes(b"hello")
    with pytest.raises(RecordingError, match="not a readable recording"):
        open_recording(path)
    path.write_bytes(written.read_bytes()[:5000])
    with pytest.raises(RecordingError, match="not a readable recording"):
        open_recording(path)
    with pytest.raises(FileNotFoundError, match="no such file"):
        open_recording(tmp_path / "none.h5")


def test_components_of_a_vector_are_plotted_together(tmp_path: Path) -> None:
    time = np.arange(5.0)
    streams = {name: Series(time * k, time, "N") for k, name in enumerate(["force_x", "force_y", "other"])}
    recording = replace(sample_recording(frames=0), streams=streams)
    plot = nxload(write_recording(recording, tmp_path / "run.h5"))["entry/plot"]
    assert plot.nxsignal.nxname == "force_x"
    assert [str(name) for name in np.atleast_1d(plot.attrs["auxiliary_signals"])] == ["force_y"]


def test_no_changed_byte_of_a_number_goes_unnoticed(tmp_path: Path) -> None:
    """Short channels as well: each dataset of numbers has its checksum."""
    path = write_recording(sample_recording(40, frames=2), tmp_path / "run.h5")
    with h5py.File(path) as file:
        bare: list[str] = []
        file.visititems(
            lambda name, item: bare.append(name) if isinstance(item, h5py.Dataset) and not _checked(item) else None
        )
        assert not bare
    whole = path.read_bytes()
    for channel in open_recording(path).streams.values():
        spot = whole.find(np.asarray(channel.value[3:5]).tobytes())
        assert spot > 0, "short channels are stored as they are"
        path.write_bytes(whole[:spot] + b"\x55" + whole[spot + 1 :])
        with pytest.raises(RecordingError, match=r"run\.h5"):
            open_recording(path)


def _checked(dataset: h5py.Dataset) -> bool:
    """Whether a changed byte shows: texts and single values have no checksum, frames their own CRC."""
    return dataset.ndim == 0 or dataset.name.endswith("frames/data") or bool(dataset.fletcher32)
