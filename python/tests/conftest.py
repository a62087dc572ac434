from pathlib import Path

import pytest

import sps

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="session")
def encoder():
    return sps.Encoder("efficientnet-lite-body", "built-in")
