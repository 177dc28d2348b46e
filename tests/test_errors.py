"""Promises of errors."""

from __future__ import annotations

import pickle

import pytest

from rcare_marl import errors


@pytest.mark.parametrize(
    "error",
    [
        errors.ConfigError("two metres is no angle"),
        errors.UnknownNameError("robot", "pr3", ["pr2", "hsr"]),
        errors.MissingPackageError("the live page", "view"),
        errors.MissingPackageError("the plot", package="matplotlib"),
    ],
)
def test_an_error_comes_back_whole_from_another_process(error: errors.RcareError) -> None:
    back = pickle.loads(pickle.dumps(error))
    assert type(back) is type(error) and str(back) == str(error)
