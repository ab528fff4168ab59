"""Messages of refusals."""

import pytest

from taichi_ldem.errors import SceneError


def one_line(error: pytest.ExceptionInfo[SceneError]) -> str:
    """The message, which is one line that is not empty."""
    message = str(error.value)
    assert message
    assert "\n" not in message
    return message
