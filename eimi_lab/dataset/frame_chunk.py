"""Compress frames with ISA-L (Intel's igzip) in the format of HDF5's filters gzip and fletcher32."""

from __future__ import annotations

from typing import Any

import h5py
import numpy as np
from isal import isal_zlib
from numpy.typing import NDArray

from eimi_lab.dataset.repair.checksums import fletcher32

_LEVEL = 1  # level of igzip that compresses like level 1 of gzip in a quarter of the time
_FILTERS = (h5py.h5z.FILTER_DEFLATE, h5py.h5z.FILTER_FLETCHER32)


def compressed(image: NDArray[Any]) -> bytes:
    """Return an image as an HDF5 chunk: the compressed bytes, then their Fletcher-32 checksum.

    The image has the shape (H, W), or (H, W, 3) with the colours red, green, blue.
    """
    data = isal_zlib.compress(np.ascontiguousarray(image), level=_LEVEL)
    return bytes(data) + fletcher32(data).to_bytes(4, "little")


def write_chunk(stack: h5py.Dataset, row: int, chunk: bytes) -> None:
    """Write a compressed image as frame number ``row`` of an HDF5 array of frames.

    ``chunk`` comes from `compressed`. The array comes from `layout.frame_stack` and has more than ``row`` rows.
    """
    stack.id.write_direct_chunk((row, *(0 for _ in stack.shape[1:])), chunk)


def append_image(stack: h5py.Dataset, image: NDArray[Any]) -> None:
    """Append an image with the colours red, green, blue to an HDF5 array of frames."""
    row = len(stack)
    stack.resize(row + 1, axis=0)
    properties = stack.id.get_create_plist()
    filters = tuple(properties.get_filter(number)[0] for number in range(properties.get_nfilters()))
    if filters == _FILTERS and stack.chunks == (1, *image.shape):
        write_chunk(stack, row, compressed(image))
    else:
        stack[row] = image
