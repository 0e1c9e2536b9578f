"""A report as one HTML page that needs nothing else: style sheet inside, drawings inline, pictures as data."""

from __future__ import annotations

import base64
from functools import cache
from typing import TYPE_CHECKING

from ..pictures.solid import library
from ..words import to_html
from .blocks import MARKS, Report

if TYPE_CHECKING:
    from jinja2 import Environment


def render_html(report: Report) -> str:
    """The page as text; the same report gives the same text.

    Raises
    ------
    NoViewerError
        A figure has a scene to be turned, and the library for it is not installed.
    """
    turned = any(figure.scene for figure in report.figures)
    return _environment().get_template("report.html.j2").render(report=report, viewer=library() if turned else "")


@cache
def _environment() -> Environment:
    from jinja2 import Environment, PackageLoader, StrictUndefined
    from markupsafe import Markup

    environment = Environment(
        loader=PackageLoader("roslf_design.reporting"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters["symbols"] = lambda text: Markup(to_html(text))
    environment.filters["data_uri"] = lambda png: "data:image/png;base64," + base64.b64encode(png).decode()
    environment.filters["kind"] = lambda block: type(block).__name__.lower()
    environment.tests["drawing"] = lambda content: isinstance(content, str)
    environment.globals["marks"] = MARKS
    return environment
