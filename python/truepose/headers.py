"""Locations of the headers, libraries and CMake files for C and C++ in the installed package."""

from pathlib import Path

from truepose.exceptions import TrueposeError


def get_include() -> str:
    """Return the folder for a compiler's include path: ``#include "truepose/truepose.hpp"``.

    The libraries are in the folder ``lib`` beside it. TrueposeError if the package runs from its
    source tree: installation adds headers and libraries.
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
        raise TrueposeError(f"no C++ package in {folder}: install truepose (pip install .)")
    return str(folder)
