"""From camera frames to apex height and profile: the threshold pipeline on a whole recording."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from acquire.analysis.cycles import suction_cycles
from acquire.recording.lazy import LazyFrames
from acquire.recording.model import Event, Frames, Recording, Series

if TYPE_CHECKING:
    from drivers.aspiration.contour import Settings
    from drivers.contour import Contour

CHANNEL = "apex_height"


def with_contour(recording: Recording, settings: Settings | None = None) -> Recording:
    """``recording`` with the contours of its frames; unchanged where there are no frames or their scale is not known.

    Derived: ``apex_low`` and ``apex_high`` (the band from GVT ± delta), ``profile`` (n, width), all in m, and
    ``contour_confidence``; the stream ``apex_height`` where the recording had none. Heights count from the tissue
    before the suction began (its own height above the foot is the calibration ``initial_height``), or from the foot of
    the bubble where no frame shows it before suction. The GVT in use is the calibration ``gvt``.

    Raises ValueError for settings that do not fit the frames.
    """
    from drivers.aspiration.contour import Settings, analyse_frames

    frames = recording.frames
    if frames is None or not len(frames.time) or not frames.scale:
        return recording
    # Live contours would be read the same again, unless other settings are asked for.
    live = frames.data.contour if settings is None and isinstance(frames.data, LazyFrames) else None
    settings = settings or Settings(**_known(recording))
    before = _frames_before_suction(recording, frames)
    found = analyse_frames(frames.data, frames.scale, replace(settings, initial_frames=max(before, 1)), live)
    zero = found["initial_height"] if before and np.isfinite(found["initial_height"]) else 0.0

    def series(value: Any, unit: str = "m") -> Series:
        return Series(np.asarray(value, float), frames.time, unit, seq=frames.seq, stage="sensor")

    derived = {
        "apex_low": series(found["band_low"] - zero),
        "apex_high": series(found["band_high"] - zero),
        "profile": series(found["profile"]),
        "contour_confidence": series(found["confidence"], "1"),
    }
    streams = dict(recording.streams)
    streams.setdefault(CHANNEL, series(found["height"] - zero))
    known = dict(recording.info.calibration.get("gvt", {}))
    provenance = known.get("provenance", "documented" if settings.gvt is not None else "measured")
    how = "set" if provenance == "documented" else "proposed"
    # How sure a proposal before the run was is not known here.
    sure = f", confidence {found['gvt_confidence']:.2f}" if settings.gvt is None else ""
    seen = {"apex": settings.apex, "tissue": settings.tissue}
    calibration = {
        **recording.info.calibration,
        "gvt": {**known, "value": float(found["gvt"]), "unit": "1", "provenance": provenance, **seen},
        "initial_height": {"value": float(zero), "unit": "m", "provenance": "measured"},
    }
    text = (
        f"grey-value threshold {found['gvt']:.0f}, {how}{sure}; {len(frames.time) - found['reread']} of "
        f"{len(frames.time)} frames were read during the run; heights count from "
    )
    text += f"the tissue before suction, {1e3 * zero:.3f} mm above the foot" if zero else "the foot of the bubble"
    return replace(
        recording,
        info=replace(recording.info, calibration=calibration),
        streams=streams,
        derived={**recording.derived, **derived},
        events=(*recording.events, Event(float(frames.time[0]), "info", "contour", text)),
    )


def contour_of(recording: Recording, index: int) -> Contour | None:
    """The contour in one frame at the recording's GVT, for an overlay; None where no GVT was found."""
    from drivers.aspiration.contour import Settings, analyse_frame

    if recording.frames is None or "gvt" not in recording.info.calibration:
        return None
    return analyse_frame(np.asarray(recording.frames.data[index]), Settings(**_known(recording)))


def _known(recording: Recording) -> dict[str, Any]:
    """The settings that the run was planned with, as its calibration tells them; none where nothing was settled."""
    gvt = recording.info.calibration.get("gvt")
    return {} if gvt is None else {"gvt": float(gvt["value"]), **{k: gvt[k] for k in ("apex", "tissue") if k in gvt}}


def _frames_before_suction(recording: Recording, frames: Frames) -> int:
    cycles = suction_cycles(recording)
    return int(np.searchsorted(frames.time, cycles[0].onset, side="right")) if cycles else 0
