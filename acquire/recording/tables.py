"""Columns of numbers from CSV, TSV and XLSX files, with the line and column of whatever is not a number."""

from __future__ import annotations

import codecs
import csv
import io
import re
import zipfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from acquire.recording.model import FloatArray, RecordingError
from protocols import units
from protocols.files import contents, is_file, number, refusing
from protocols.text import did_you_mean

MAX_BYTES = 2**29  # of text
# A workbook is a zipped XML, some hundred times larger once unpacked, and is read cell by cell: a second or two for
# as many cells as these. More belong into a CSV, which is read a hundred times quicker.
MAX_UNPACKED = 2**26
MAX_CELLS = 500_000
MAX_COUNT = 2**53  # beyond, floats skip whole numbers
UTF_16 = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
MINUS = "\N{MINUS SIGN}"
SEPARATORS = {",": "a comma", ";": "a semicolon", "\t": "a tab"}
_NOT_FINITE = ("nan", "inf", "-inf", "+inf")
# A cell that begins with one of these is run as a formula when somebody opens the table in a spreadsheet; an
# apostrophe before it, which spreadsheets hide, makes it a text again.
_FORMULA = re.compile(r"'*[=+\-@\t\r]")


def title_in_csv(name: str) -> str:
    """A column's name as it is written: an apostrophe comes before whatever a spreadsheet would run as a formula.

    No two names are written alike; `Table.column` finds a column by its name.
    """
    return f"'{name}" if _FORMULA.match(name) else name


def text_in_csv(written: str) -> str:
    """The text that `title_in_csv` wrote as ``written``."""
    return written[1:] if written.startswith("'") and _FORMULA.match(written) else written


def _quoted(text: str) -> str:
    doubled = text.replace('"', '""')
    return f'"{doubled}"'


def write_table(path: Path, columns: Mapping[str, NDArray[Any]]) -> None:
    """A CSV of equally long ``columns``; floats carry every digit, names are quoted and escaped (`title_in_csv`)."""
    with path.open("w", encoding="utf-8", newline="") as file:
        # Plain titles stay without quotes, so that the numbers below are read the quick way.
        titles = (title_in_csv(name) for name in columns)
        file.write(",".join(t if re.fullmatch(r"[^\s,;\"]+( [^\s,;\"]+)*", t) else _quoted(t) for t in titles) + "\n")
        rows: Iterable[tuple[Any, ...]] = zip(
            *(np.asarray(column).tolist() for column in columns.values()), strict=True
        )
        file.writelines(",".join(map(repr, row)) + "\n" for row in rows)


class Table:
    """One file of columns under a header row. Raises RecordingError that names the file and, where it can, the line.

    Lines beginning with ``#`` before the header are skipped, and a row of units below it; a CSV may be separated by
    comma, semicolon (then with a decimal point or a decimal comma) or tab.
    """

    def __init__(self, path: Path, sheet: str | None = None) -> None:
        self.path = path
        self.sheet = sheet
        if not is_file(path):
            raise RecordingError(f"{path}: no such file")
        if path.suffix.lower() == ".xlsx":
            self._lines, self._rows = _workbook(path, sheet)
            self._numbers = None
        else:
            text, separator = _text(path)
            self._numbers = _plain_numbers(text, separator)
            head = text if self._numbers is None else text.partition("\n")[0]
            self._lines, self._rows = _text_rows(path, head, separator)
        if not self._rows:
            raise RecordingError(f"{path}: there is no header row")
        self.header = [name.strip() for name in self._rows[0]]
        if self._numbers is not None and self._numbers.shape[1] != len(self.header):
            self._numbers = None
            self._lines, self._rows = _text_rows(path, text, separator)
        if len(self._rows) > 1 and _of_units(self._rows[1]):
            del self._rows[1], self._lines[1]
        self._columns: dict[tuple[str, bool], tuple[FloatArray, Sequence[int]]] = {}
        if path.suffix.lower() != ".xlsx" and self._numbers is None:
            self._check_separators(separator)
            self._check_widths(separator)

    def _check_separators(self, separator: str) -> None:
        """Refuse rows that are separated otherwise than the header is."""
        if len(self.header) < 2 or len(self._rows) < 2 or len(self._rows[1]) > 1:
            return
        for other in SEPARATORS.keys() - {separator}:
            if len(self._rows[1][0].split(other)) == len(self.header):
                texts = f"columns of the header are separated by {SEPARATORS[separator]}, those of this line by"
                raise RecordingError(f"{self.path}:{self._lines[1]}: the {texts} {SEPARATORS[other]}")

    def _check_widths(self, separator: str) -> None:
        """Refuse a row with a cell that no heading names: of two halves of a number each would be taken for one."""
        width = len(self.header)
        for line, row in zip(self._lines[1:], self._rows[1:], strict=True):
            if any(cell.strip() for cell in row[width:]):
                comma = ": is a decimal comma among them?" if separator == "," else ""
                above = " A line above the headings begins with #." if width == 1 else ""
                headings = "1 heading" if width == 1 else f"{width} headings"
                raise RecordingError(f"{self.path}:{line}: {len(row)} cells under {headings}{comma}{above}")

    def column(self, name: str, channel: str, *, allow_nan: bool = False) -> tuple[FloatArray, Sequence[int]]:
        """Values (n,) of the column ``name`` and the line of each in the file; empty cells at its end are no samples.

        ``channel`` is who asks: it is named in the RecordingError for a missing, doubled or empty column, and for a
        cell that is not a finite number (``nan``, or an empty one among others, is none unless ``allow_nan``).
        """
        if (name, allow_nan) not in self._columns:
            self._columns[name, allow_nan] = self._read(name, channel, "nan" if allow_nan else "")
        values, lines = self._columns[name, allow_nan]
        bad = np.flatnonzero(np.isinf(values) if allow_nan else ~np.isfinite(values))
        if len(bad):
            text = repr(float(values[bad[0]]))
            raise self.fault(lines[bad[0]], channel, name, f"{text!r} is not a finite number")
        return values, lines

    def counter(self, name: str, channel: str) -> NDArray[np.int64]:
        """Whole numbers (n,) of the column ``name``. Raises as `column`, and for a value that is no whole number."""
        values, lines = self.column(name, channel)
        bad = np.flatnonzero((values != np.rint(values)) | (np.abs(values) > MAX_COUNT))
        if len(bad):
            raise self.fault(lines[bad[0]], channel, name, f"{float(values[bad[0]])!r} is not a count")
        return values.astype(np.int64)

    def _read(self, name: str, channel: str, empty: str) -> tuple[FloatArray, Sequence[int]]:
        """A column and its lines; an ``empty`` cell counts as this."""
        found: list[int] = []
        for written in (title_in_csv(name.strip()), name.strip()):
            found = found or [index for index, title in enumerate(self.header) if title == written]
        if not found:
            raise RecordingError(f"{self.path}: channel {channel}: no column {name!r}{did_you_mean(name, self.header)}")
        if len(found) > 1:
            raise RecordingError(f"{self.path}: channel {channel}: {len(found)} columns are called {name!r}")
        index = found[0]
        if self._numbers is not None:
            return self._numbers[:, index].copy(), range(2, len(self._numbers) + 2)
        cells = [row[index].strip() if index < len(row) else "" for row in self._rows[1:]]
        while cells and not cells[-1]:
            cells.pop()
        if not cells:
            raise RecordingError(f"{self.path}: channel {channel}: column {name!r} is empty")
        lines = self._lines[1 : len(cells) + 1]
        values = [self._number(cell or empty, line, name, channel) for cell, line in zip(cells, lines, strict=True)]
        return np.array(values, dtype=np.float64), lines

    def _number(self, cell: str, line: int, name: str, channel: str) -> float:
        if cell.lower() in _NOT_FINITE:
            return float(cell)
        try:
            cell = cell.replace(MINUS, "-")  # as typesetting has it
            # A decimal comma cannot be a thousands separator here: a number has at most one.
            return number(cell.replace(",", ".", 1) if "." not in cell else cell)
        except ValueError:
            what = (
                f"{cell[:40]!r} is not a number" if cell else "the cell is empty; allow_nan takes empty cells of values"
            )
            if _is_a_date(cell):
                what = f"{cell[:40]!r} is a date: write seconds, and when they began as run.start_time"
            raise self.fault(line, channel, name, what) from None

    def fault(self, line: int, channel: str, name: str, what: str) -> RecordingError:
        """A fault of the column ``name`` in this line of the file."""
        return RecordingError(f"{self.path}:{line}: channel {channel}, column {name!r}: {what}")


def _is_a_date(cell: str) -> bool:
    """Whether a cell is a date, with or without a time of day; digits alone are a number that something else spoils."""
    try:
        datetime.fromisoformat(cell)
    except ValueError:
        return False
    return not cell.isdigit()


def _of_units(row: Sequence[str]) -> bool:
    """Whether a row below the header tells units: each of its cells, bracketed or not, is one or empty."""
    cells = [cell.strip().strip("[]()").strip() for cell in row]
    if not any(cells) or any(cell[:1].isdigit() or cell.lower() in _NOT_FINITE for cell in cells):
        return False
    try:
        return all(bool(units.to_si(cell)) for cell in cells if cell not in ("", "-"))
    except ValueError:
        return False


def _text(path: Path) -> tuple[str, str]:
    """The file's text and the separator of its columns."""
    try:
        raw = contents(path, MAX_BYTES)
    except ValueError as error:
        raise RecordingError(str(error)) from error
    try:
        text = raw.decode("utf-16" if raw.startswith(UTF_16) else "utf-8-sig")
    except UnicodeDecodeError:
        text = raw.decode("latin-1")  # older instrument software writes it; only headers can be affected
    if "\0" in text:
        raise RecordingError(f"{path}: not a text file")
    first = next((line for line in io.StringIO(text) if line.strip() and not line.startswith("#")), "")
    bare = re.sub(r'"[^"]*("|$)', "", first)  # quoted text separates nothing
    if path.suffix.lower() in (".tsv", ".tab") or "\t" in bare:
        return text, "\t"
    return text, ";" if ";" in bare else ","


def _plain_numbers(text: str, separator: str) -> FloatArray | None:
    """All cells (rows, columns) below the first line, if that is the header and all of them are numbers.

    The common case, ten times quicker than looking at every cell; whatever is not that plain is read cell by cell.
    """
    header, _, body = text.partition("\n")
    if not body.strip() or header.startswith("#") or '"' in header:
        return None
    try:
        numbers = np.loadtxt(io.StringIO(body), delimiter=separator, comments=None, ndmin=2)
    except ValueError:
        return None
    # A blank line is skipped by the reader, and line numbers would no longer be right.
    return numbers if len(numbers) == body.rstrip("\r\n").count("\n") + 1 else None


def _text_rows(path: Path, text: str, separator: str) -> tuple[list[int], list[list[str]]]:
    lines: list[int] = []
    rows: list[list[str]] = []
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=separator)
    try:
        for row in reader:
            comment = not rows and row and row[0].startswith("#")
            if not comment and any(map(str.strip, row)):
                lines.append(reader.line_num)
                rows.append(row)
    except csv.Error as error:
        raise RecordingError(f"{path}:{reader.line_num}: {error}") from error
    return lines, rows


def _workbook(path: Path, sheet: str | None) -> tuple[list[int], list[list[str]]]:
    import openpyxl

    with refusing(path, RecordingError, "not a readable workbook"):
        with zipfile.ZipFile(path) as archive:
            size = sum(member.file_size for member in archive.infolist())
        if size > MAX_UNPACKED:
            raise RecordingError(f"{path}: unpacks to {size} bytes; more than {MAX_UNPACKED} are refused: write a CSV")
        book = openpyxl.load_workbook(path, read_only=True, data_only=True, keep_links=False)
        try:
            if sheet is not None and sheet not in book.sheetnames:
                raise RecordingError(f"{path}: no sheet {sheet!r}{did_you_mean(sheet, book.sheetnames)}")
            if not book.worksheets:
                raise RecordingError(f"{path}: there is no sheet of cells")
            chosen = book[sheet] if sheet is not None else book.worksheets[0]
            chosen.reset_dimensions()  # the file's own claim is not believed: rows would be padded to it
            lines, rows = [], []
            for line, cells in _bounded(chosen.iter_rows(values_only=True), path):
                row = ["" if cell is None else str(cell) for cell in cells]
                if any(map(str.strip, row)):
                    lines.append(line)
                    rows.append(row)
            return lines, rows
        finally:
            book.close()


def _bounded(rows: Iterable[Sequence[Any]], path: Path) -> Iterator[tuple[int, Sequence[Any]]]:
    """Rows with their numbers, until they are more than a workbook may have."""
    count = 0
    for line, cells in enumerate(rows, start=1):
        count += 1 + len(cells)
        if count > MAX_CELLS:
            raise RecordingError(f"{path}: more than {MAX_CELLS} cells in a sheet are refused: write a CSV")
        yield line, cells


def evenly(count: int, rate: float, start: float) -> NDArray[np.float64]:
    """Times (count,) in s of samples at ``rate`` Hz from ``start`` s on."""
    return start + np.arange(count) / rate
