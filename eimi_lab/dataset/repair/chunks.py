"""Correct flipped bits in the chunks (stored pieces) of an array that have fletcher32 checksums."""

from __future__ import annotations

import h5py

from eimi_lab.dataset.repair.checksums import fletcher32, flipped_bit_of_chunk
from eimi_lab.dataset.repair.mended_file import MendedFile

FLETCHER32 = 3  # number of this filter in HDF5


def mend_chunks(file: MendedFile, dataset: h5py.Dataset) -> int:
    """Correct one flipped bit in each chunk (stored piece) of an array that has a wrong checksum.

    Parameters
    ----------
    file : MendedFile
        The file, whose bytes are corrected in memory.
    dataset : h5py.Dataset
        The array.

    Returns
    -------
    int
        The number of corrected chunks; 0 without fletcher32 checksums.
    """
    plist = dataset.id.get_create_plist()
    filters = [plist.get_filter(number)[0] for number in range(plist.get_nfilters())]
    if not dataset.chunks or filters[-1:] != [FLETCHER32]:
        return 0
    mended = 0
    for number in range(dataset.id.get_num_chunks()):
        chunk = dataset.id.get_chunk_info(number)
        raw = file.bytes_at(chunk.byte_offset, chunk.size)
        if len(raw) < max(chunk.size, 8) or fletcher32(raw[:-4]) == int.from_bytes(raw[-4:], "little"):
            continue
        bit = flipped_bit_of_chunk(raw)
        if bit is not None:
            file.flip(chunk.byte_offset, bit)
            mended += 1
    return mended
