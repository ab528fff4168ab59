"""Folders of the repository that tests read from."""

from pathlib import Path

TESTS = Path(__file__).resolve().parents[1]
ROOT = TESTS.parent
CONFIGS = ROOT / "configs"
"""Scene files that users start from."""
SCENES = TESTS / "scenes"
"""Scene files for tests only."""
DATA = TESTS / "data"
"""Broken bars of recorded runs."""
