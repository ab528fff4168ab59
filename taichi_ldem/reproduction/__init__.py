"""The paper in one command."""
