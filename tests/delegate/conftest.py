import pytest
from pxr import Usd
from stages import new_stage


@pytest.fixture
def stage() -> Usd.Stage:
    """A stage in memory, Y up, with /World."""
    return new_stage()
