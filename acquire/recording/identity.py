"""Texts and numbers that identify the subject and measurement of a run, as every file of ours carries them."""

from __future__ import annotations

import re
from typing import Annotated

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError

from acquire.recording.model import RecordingError, RunInfo

MAX_REPEAT = 1_000_000
_CONTROL = re.compile(r"[\x00-\x08\x0b\x0c\x0e-\x1f\x7f]")


def _printable(text: str) -> str:
    if _CONTROL.search(text):
        raise ValueError("has a control character")
    return text


def _one_line(text: str) -> str:
    if text.splitlines() not in ([], [text]):
        raise ValueError("must be one line")
    return _printable(text)


Line = Annotated[str, Field(max_length=400), AfterValidator(_one_line)]
Text = Annotated[str, Field(max_length=1_000_000), AfterValidator(_printable)]


class _Identity(BaseModel):
    """The fields of `RunInfo` that come from people and files."""

    model_config = ConfigDict(strict=True)

    id: Annotated[Line, Field(min_length=1)]
    instrument: Annotated[Line, Field(min_length=1, max_length=80)]
    subject: Line
    site: Line
    consent: Line
    experiment: Line
    operator: Line
    specimen: Line
    protocol_name: Line
    start_time: Line
    notes: Text
    protocol: Text
    station: Text
    repeat: Annotated[int, Field(ge=0, le=MAX_REPEAT)]


def check_identity(info: RunInfo) -> None:
    """Raises RecordingError that names the first field of ``info`` that cannot be recorded, and why."""
    try:
        _Identity.model_validate({name: getattr(info, name) for name in _Identity.model_fields})
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        words = first["msg"].removeprefix("Value error, ")
        if first["type"] == "string_unicode":
            words = "is not UTF-8 text"
        raise RecordingError(f"{first['loc'][0]}: {words}") from None
