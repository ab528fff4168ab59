"""A hook of mkdocs: links to files outside of docs/ become plain text on the site."""

import re
from typing import Any

# [text](../path#anchor); the text is kept, because the source is not part of the site
OUTSIDE = re.compile(r"\[([^\]]*)\]\(\.\./[^)\s]+\)")


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Replace links to the source with their text."""
    return OUTSIDE.sub(r"\1", markdown)
