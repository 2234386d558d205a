"""What a call says as it refuses."""

import pytest


def refusal(kind, call, *arguments, **named):
    """Return the message of the error of this kind that the call raises."""
    with pytest.raises(kind) as caught:
        call(*arguments, **named)
    return str(caught.value)
