"""Correct flipped bits in the chunks of an array that HDF5 stored with the filter fletcher32.

This filter appends a checksum to each chunk.
"""

from __future__ import annotations

import h5py

from eimi_lab.dataset.repair.checksums import fletcher32, flipped_bit_of_chunk
from eimi_lab.dataset.repair.mended_file import MendedFile

FLETCHER32 = 3  # number of this filter in HDF5


def mend_chunks(file: MendedFile, dataset: h5py.Dataset) -> int:
    """Correct one flipped bit in each chunk that has a wrong checksum. A chunk is a stored piece of an array.

    Parameters
    ----------
    file : MendedFile
        The file, in which the corrected bytes are replaced in memory.
    dataset : h5py.Dataset
        The array.

    Returns
    -------
    int
        The number of corrected chunks; 0 if the array is not stored with the filter fletcher32.
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
