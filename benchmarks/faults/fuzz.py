"""Decoders fed with damaged bytes: codecs, the camera's frames, the journal's reader, YAML and bundles.

Each may refuse (a ValueError), and nothing else. Where atheris is installed, `python -m benchmarks.faults.fuzz TARGET`
lets it look for inputs by coverage; the campaign itself mutates sound inputs, seeded.
"""

from __future__ import annotations

import itertools
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from random import Random

import numpy as np

from benchmarks.faults.inputs import BUNDLE, PROTOCOL, STATION, Samples
from benchmarks.faults.mutate import spoil_journal, spoil_message, spoiled
from benchmarks.faults.table import Campaign, Part, Row
from drivers import messages as msg
from drivers.device import Identity, Status
from protocols.limits import Range

#: Executions in the full campaign by kind of target. They grow with the cube of the share: a tenth makes ten thousand.
#: Codecs reach them; a journal is a file and YAML takes 10 ms in Python alone: these end by the campaign's budget.
FULL = 10_000_000
CODECS = ("cutometer", "pressure", "robot", "frames")
TARGETS = (*CODECS, "journal", "YAML-protocol", "YAML-station", "YAML-bundle")
LEAST, LOOK = 200, 64  # executions whatever they cost, and between two looks at the clock


def targets(folder: Path) -> dict[str, tuple[Callable[[bytes], object], list[bytes]]]:
    """Name -> decoder and sound inputs."""
    from acquire.recording import read_journal
    from acquire.recording.bundle_schema import Bundle
    from acquire.station import Station
    from drivers.aspiration.framelink import FrameDecoder, Picture, encode
    from drivers.aspiration.pressure import PressureCodec
    from drivers.cutometer.codec import CutometerCodec
    from drivers.microrobot.codec import MicrorobotCodec
    from protocols.schema import Protocol
    from protocols.source import read
    from protocols.text import validate

    journal = folder / "fuzzed.journal"

    def journals(data: bytes) -> object:
        journal.write_bytes(data)
        return read_journal(journal)

    def yaml(model: type) -> Callable[[bytes], object]:
        def load(data: bytes) -> object:
            found, source = read(data.decode("utf-8", "replace") + "\n")
            return validate(model, found, source)

        return load

    found: dict[str, tuple[Callable[[bytes], object], list[bytes]]] = {}
    for name, codec, width in (
        ("cutometer", CutometerCodec, 2),
        ("pressure", PressureCodec, 1),
        ("robot", MicrorobotCodec, 6),
    ):
        sound = [codec().encode(message) for message in _messages(3 if name == "robot" else 1, width)]
        # One decoder for all: what it keeps of one input must not harm it in the next.
        found[name] = (codec().decode, [*sound, b"".join(sound)])
    picture = encode(Picture(np.zeros((4, 5), np.uint8), 1, 0.5))
    found["frames"] = (FrameDecoder().feed, [picture, picture + picture, encode(Identity("a camera", "1", "2"))])
    found["journal"] = (journals, [Samples(folder).journal])
    found["YAML-protocol"] = (yaml(Protocol), [PROTOCOL.encode()])
    found["YAML-station"] = (yaml(Station), [STATION.encode()])
    found["YAML-bundle"] = (yaml(Bundle), [BUNDLE.encode()])
    return found


def _messages(quantities: int, width: int) -> list[msg.Message]:
    """One message of each kind, in both directions."""
    limits = {"pressure": Range(-5e4, 0.0, 1e4, 60.0)}
    piece = msg.Piece(1.5, (0.0,) * quantities, (0.0,) * quantities)
    bodies = (
        *(msg.Identify(), msg.Stream(True), msg.Arm(limits, 0.25, 7), msg.Enqueue((piece, piece)), msg.Start()),
        *(msg.Hold(), msg.Skip(3), msg.Safe()),
    )
    replies = (msg.Reply(1), msg.Reply(2, "not armed"), msg.Reply(3, identity=Identity("simulated", "1", "2")))
    samples = msg.Samples(40, np.arange(4) / 100, np.zeros((4, width)), Status(0.4, "running", 2, 1, "", 0.1), 9)
    return [msg.Beat(7), *(msg.Request(n + 1, body) for n, body in enumerate(bodies)), *replies, samples]


def rows(target: str, campaign: Campaign) -> Iterator[Row]:
    """The row of one target."""
    row = Row(f"fuzzing, {target}", "takes it, or refuses it with a ValueError")
    with tempfile.TemporaryDirectory(prefix="faults-") as name:
        decode, seeds = targets(Path(name))[target]
        spoil = _spoil(target, campaign)
        full, began = max(LEAST, round(FULL * campaign.share**3)), time.process_time()
        budget = float("inf") if target in CODECS else campaign.budget
        for number in range(full):
            data = spoil(seeds[number % len(seeds)])
            row.trial(problem=_problem(decode, data))
            if number % LOOK == 0 and number >= LEAST and time.process_time() - began > budget:
                row.exception = f"ended by its budget of {budget:g} s of processor time, short of {full}"
                break
    row.must += f" ({row.trials / (time.process_time() - began):.0f} executions/s)"
    yield row


def _spoil(target: str, campaign: Campaign) -> Callable[[bytes], bytes]:
    if target in CODECS:
        quick = Random(f"{campaign.seed} {target}")
        return lambda data: spoil_message(data, quick)
    random = campaign.random(target)
    return lambda data: (spoil_journal if target == "journal" else spoiled)(data, random)


def _problem(decode: Callable[[bytes], object], data: bytes) -> str:
    try:
        decode(data)
    except ValueError:
        pass
    except Exception as error:  # whatever it is, it would be a traceback
        return f"{type(error).__name__}: {error} for {data[:60]!r}"
    return ""


def main(arguments: list[str]) -> None:
    """Fuzz one target by coverage until it is stopped. Raises ImportError without atheris."""
    import atheris

    with tempfile.TemporaryDirectory(prefix="faults-") as name:
        with atheris.instrument_imports(include=["acquire", "drivers", "protocols"]):
            known = targets(Path(name))
        decode, seeds = known[arguments[1]]
        corpus = Path(name) / "corpus"
        corpus.mkdir()
        for number, seed in zip(itertools.count(), seeds, strict=False):
            (corpus / str(number)).write_bytes(seed)

        def once(data: bytes) -> None:
            problem = _problem(decode, data)
            if problem:
                raise AssertionError(problem)

        atheris.Setup([arguments[0], *arguments[2:], str(corpus)], once)
        atheris.Fuzz()


CLOCKED = False
PARTS: dict[str, Part] = {target: partial(rows, target) for target in TARGETS}

if __name__ == "__main__":
    main(sys.argv)
