"""The kinds of value a protocol's fields have."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, GetCoreSchemaHandler, GetJsonSchemaHandler
from pydantic_core import CoreSchema, core_schema

from protocols import units


class Model(BaseModel):
    """Frozen, and a key it does not know is a fault."""

    model_config = ConfigDict(frozen=True, extra="forbid")


@dataclass(frozen=True)
class Unit:
    """Marks a float field: text with a unit in YAML and JSON, SI inside.

    ``sign`` is ``any``, ``positive`` or ``not negative``; ``least`` and ``most`` (SI) bound it further.
    """

    kind: str
    sign: str = "any"
    least: float = -math.inf
    most: float = math.inf

    def read(self, value: object) -> float:
        """Parse and check the sign."""
        number = units.parse(value, self.kind)
        if (self.sign == "positive" and number <= 0) or (self.sign == "not negative" and number < 0):
            raise ValueError(f"must {'be positive' if self.sign == 'positive' else 'not be negative'}, not {value!r}")
        if not self.least <= number <= self.most:
            raise ValueError(f"must be {self._bounds()}, not {value!r}")
        return number

    def _bounds(self) -> str:
        if math.isinf(self.most):
            return f"at least {self.write(self.least)}"
        most = self.write(self.most)
        return f"at most {most}" if math.isinf(self.least) else f"{self.write(self.least)} … {most}"

    def write(self, value: float) -> str:
        """The inverse of `read`."""
        return units.write(value, self.kind)

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.no_info_plain_validator_function(
            self.read,
            serialization=core_schema.plain_serializer_function_ser_schema(
                self.write, return_schema=core_schema.str_schema()
            ),
        )

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        example = units.KINDS[self.kind][1][0]
        sign = "" if self.sign == "any" else f", {self.sign}"
        return {
            "type": "string",
            "pattern": r"^\s*[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?\s*[^\d\s].*$",
            "description": f"a {self.kind} with its unit, e.g. in {example}{sign}",
        }


Pressure = Annotated[float, Unit("pressure")]
Suction = Annotated[float, Unit("pressure", "not negative")]
PressureRate = Annotated[float, Unit("pressure rate", "positive")]
Length = Annotated[float, Unit("length")]
Size = Annotated[float, Unit("length", "positive")]
Speed = Annotated[float, Unit("speed", "positive")]
#: No instrument carries out anything shorter than a step of its controller (1 ms).
Duration = Annotated[float, Unit("time", "positive", least=1e-3)]
Frequency = Annotated[float, Unit("frequency", "positive")]
#: Openings are 1 to 10 mm wide, holes of support plates some centimetres at most: beyond that a unit is wrong.
Bore = Annotated[float, Unit("length", "positive", 0.1e-3, 100e-3)]
Force = Annotated[float, Unit("force", "not negative")]
Angle = Annotated[float, Unit("angle")]
Count = Annotated[int, Field(strict=True, ge=1, le=10_000)]
Text = Annotated[str, Field(strict=True, max_length=4000)]
