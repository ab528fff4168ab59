"""What mkdocs does beyond its own: optional pages, and links to files outside of docs/."""

import re
from pathlib import Path
from typing import Any

# [text](../path#anchor), the text kept: the source is not part of the site
OUTSIDE = re.compile(r"\[([^\]]*)\]\(\.\./[^)\s]+\)")


def on_config(config: Any) -> Any:
    """Leave pages out of the navigation that are not there."""
    config["nav"] = _existing(config["nav"], Path(config["docs_dir"]))
    return config


def _existing(entries: list[Any], docs: Path) -> list[Any]:
    kept = []
    for entry in entries:
        ((title, target),) = entry.items()
        if isinstance(target, list):
            target = _existing(target, docs)
            if target:
                kept.append({title: target})
        elif (docs / target).is_file():
            kept.append(entry)
    return kept


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Turn links to the source into their text."""
    return OUTSIDE.sub(r"\1", markdown)
