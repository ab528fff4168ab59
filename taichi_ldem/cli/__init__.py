"""The command line. No physics here."""

from taichi_ldem.cli.app import main

__all__ = ["main"]
