"""Writing a page: the template, and Plotly's script inside it."""

from __future__ import annotations

from importlib import resources
from pathlib import Path
from typing import Any

from taichi_ldem.errors import SceneError
from taichi_ldem.output.report.page import Page
from taichi_ldem.storage.durable import write_whole


def template() -> Any:
    """The page's template.

    Raises:
        SceneError: the optional packages are missing.
    """
    try:
        import jinja2
        import plotly  # noqa: F401
    except ImportError:
        raise SceneError("a report needs `pip install 'taichi-ldem[report]'`") from None
    source = resources.files("taichi_ldem.output.report").joinpath("report.html.j2")
    environment = jinja2.Environment(
        autoescape=True, trim_blocks=True, lstrip_blocks=True, undefined=jinja2.StrictUndefined
    )
    return environment.from_string(source.read_text(encoding="utf-8"))


def write_page(page: Page, path: Path) -> Path:
    """Write a page as one HTML file and return its path.

    Raises:
        SceneError: the optional packages are missing.
        OSError: the file cannot be written.
    """
    text = template().render(page=page, plotly=_plotly() if page.figures else "")
    # the name of a folder may be no text
    write_whole(path, text.encode(errors="backslashreplace"))
    return path


def _plotly() -> str:
    source = resources.files("plotly").joinpath("package_data/plotly.min.js")
    return source.read_text(encoding="utf-8")
