"""Answers to experiments: recordings that say which one they answer, believed where they carry it out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from acquire.recording.model import Recording
from gap.design.experiment import EXPERIMENT, Asked, fault, fault_by_id, read


@dataclass(frozen=True)
class Answer:
    """A recording that answers an experiment; ``fault`` says why it is not believed, and is empty where it is."""

    experiment: str
    recording: str
    fault: str

    def as_dict(self) -> dict[str, object]:
        return {"id": self.experiment, "recording": self.recording, "believed": not self.fault, "reason": self.fault}

    @property
    def text(self) -> str:
        return (
            f"recording {self.recording} is not believed: it says that it answers {self.experiment}, but {self.fault}"
        )


def asked_for(folders: Sequence[Path], files: Sequence[Path]) -> dict[str, Asked]:
    """Experiments by id: those in ``folders``, and those whose files lie beside the recordings' ``files``.

    Raises ExperimentError for one of the ``folders`` that cannot be read.
    """
    found = [read(folder) for folder in folders]
    beside = {place for file in files for place in (file, *file.resolve().parents[:2])}
    found += [read(place) for place in sorted(beside) if (place / EXPERIMENT).is_file()]
    return {asked.id: asked for asked in reversed(found)}


def believed(
    recordings: Sequence[Recording], experiments: Mapping[str, Asked] = {}
) -> tuple[list[Recording], list[Answer]]:
    """The recordings that answer no experiment, or the one they say; and every answer, believed or not."""
    kept, answers = [], []
    for r in recordings:
        if r.info.experiment:
            asked = experiments.get(r.info.experiment)
            wrong = fault_by_id(r) if asked is None else fault(r, asked)
            answers.append(Answer(r.info.experiment, r.info.id, wrong))
            if wrong:
                continue
        kept.append(r)
    return kept, answers
