"""Names that the drawing process and its caller share."""

EXIT_NO_DEVICE = 3
"""Exit code of the drawing process where there is no Vulkan device."""


def milliseconds(time_s: float) -> str:
    """A time (s) in milliseconds, for a file's name."""
    return f"{time_s * 1e3:.4f}".rstrip("0").rstrip(".")


def view_name(time_s: float, view: str) -> str:
    """File name of a standing view at a time (s)."""
    return f"crack_{milliseconds(time_s)}ms_{view}.png"


def shot_name(step: int) -> str:
    """File name of the picture of a stored step."""
    return f"shot_{step:05d}.png"
