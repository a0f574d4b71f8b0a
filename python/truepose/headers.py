"""Locations of the C++ headers and CMake files in the installed package."""

from pathlib import Path

from truepose.exceptions import TrueposeError


def get_include() -> str:
    """Return the folder for a compiler's include path: ``#include "truepose/..."``.

    TrueposeError if the package runs from its source tree: installation adds the headers.
    """
    return _installed("include")


def get_cmake_dir() -> str:
    """Return the folder of trueposeConfig.cmake, for ``cmake -Dtruepose_DIR=...``.

    A scikit-build-core build that requires truepose does not need it. TrueposeError as for
    :func:`get_include`.
    """
    return _installed("share/cmake/truepose")


def _installed(place: str) -> str:
    folder = Path(__file__).parent / "_data" / place
    if not folder.is_dir():
        raise TrueposeError(f"no C++ headers in {folder}: install truepose (pip install .)")
    return str(folder)
