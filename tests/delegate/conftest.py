import os
from collections.abc import Iterator

import pytest
from pxr import Usd
from stages import new_stage


@pytest.fixture(scope="session", autouse=True)
def cache_of_its_own(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Tests leave nothing in the user's cache folder."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(os.environ, "XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))
        yield


@pytest.fixture
def stage() -> Usd.Stage:
    """A stage in memory, Y up, with /World."""
    return new_stage()
