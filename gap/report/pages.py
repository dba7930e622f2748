"""The pages of diagnosis, loop and qualification: one layout, one style, the same words and numbers."""

from __future__ import annotations

from typing import Any

from gap.data.quantities import quantity
from gap.report.words import words


def render(package: str, template: str, **values: Any) -> str:
    """The page that ``template`` of ``package`` (its folder ``templates``) makes of ``values``.

    All pages extend ``base.html`` of this package. Text is escaped; a value that a template asks for in vain raises
    jinja2.UndefinedError.
    """
    from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined

    own, shared = PackageLoader(package, "templates"), PackageLoader("gap.report", "templates")
    environment = Environment(
        loader=ChoiceLoader([own, shared, PackageLoader("acquire.report", ".")]),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {"words": words, "quantity": quantity}
    return environment.get_template(template).render(**values)
