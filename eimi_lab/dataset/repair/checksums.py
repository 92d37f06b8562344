"""Compute the checksums of HDF5 (lookup3 for metadata, fletcher32 for chunks), and search for one flipped bit.

lookup3 is Bob Jenkins' function `hashlittle` with the initial value 0 (public domain, 2006); see HDF5 File Format
Specification 3.0, appendix B.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Words = NDArray[np.uint32]

_ROW = 512  # number of words (16 bits) in a row of the arrangement by which `fletcher32` computes its sums


def lookup3(block: bytes) -> int:
    """Return the checksum of a block of bytes (32 bits) by the function lookup3."""
    return int(lookup3_of_many(_words(np.frombuffer(block, np.uint8)[None, :]), len(block))[0])


def _words(blocks: NDArray[np.uint8]) -> Words:
    """Convert m blocks of n bytes, shape (m, n), into zero-padded little-endian words of 32 bits, shape (m, k)."""
    length = blocks.shape[1]
    padded = np.zeros((len(blocks), max(12, -(-length // 12) * 12)), np.uint8)
    padded[:, :length] = blocks
    return padded.view("<u4")


def lookup3_of_many(words: Words, length: int) -> Words:
    """Return the lookup3 checksums of m blocks of the same length.

    Parameters
    ----------
    words : (m, k) array of uint32
        k little-endian words of each block, padded with zeros to a multiple of 12 bytes.
    length : int
        Length of each block without the padding, bytes; at least 1.

    Returns
    -------
    (m,) array of uint32
        The checksums.
    """
    begin = np.uint32((0xDEADBEEF + length) & 0xFFFFFFFF)
    a, b, c = (np.full(len(words), begin) for _ in range(3))
    last = words.shape[1] - 3
    for at in range(0, last + 3, 3):
        a, b, c = a + words[:, at], b + words[:, at + 1], c + words[:, at + 2]
        if at < last:
            a, b, c = _mixed(a, b, c)
    return _final(a, b, c)


def _turned(x: Words, bits: int) -> Words:
    return (x << np.uint32(bits)) | (x >> np.uint32(32 - bits))


def _mixed(a: Words, b: Words, c: Words) -> tuple[Words, Words, Words]:
    a, c = (a - c) ^ _turned(c, 4), c + b
    b, a = (b - a) ^ _turned(a, 6), a + c
    c, b = (c - b) ^ _turned(b, 8), b + a
    a, c = (a - c) ^ _turned(c, 16), c + b
    b, a = (b - a) ^ _turned(a, 19), a + c
    c, b = (c - b) ^ _turned(b, 4), b + a
    return a, b, c


def _final(a: Words, b: Words, c: Words) -> Words:
    c = (c ^ b) - _turned(b, 14)
    a = (a ^ c) - _turned(c, 11)
    b = (b ^ a) - _turned(a, 25)
    c = (c ^ b) - _turned(b, 16)
    a = (a ^ c) - _turned(c, 4)
    b = (b ^ a) - _turned(a, 14)
    return (c ^ b) - _turned(b, 24)


def flipped_bit(block: bytes, stored: int) -> int | None:
    """Search for the bit of a block whose flip makes the lookup3 checksum equal to the checksum in the file.

    Parameters
    ----------
    block : bytes
        The block without its checksum.
    stored : int
        The checksum in the file.

    Returns
    -------
    int or None
        Index of the bit, from the lowest bit of the first byte; None if there is no such bit.
    """
    plain = np.frombuffer(block, np.uint8)
    length = len(plain)
    for first in range(0, length, 128):  # 128 bytes, that is 1024 bits, are tried at a time
        places = np.repeat(np.arange(first, min(first + 128, length)), 8)
        variants = np.tile(plain, (len(places), 1))
        variants[np.arange(len(places)), places] ^= np.tile(1 << np.arange(8), len(places) // 8).astype(np.uint8)
        matches = np.flatnonzero(lookup3_of_many(_words(variants), length) == stored)
        if len(matches):
            return 8 * first + int(matches[0])
    return None


def fletcher32(chunk: bytes) -> int:
    """Return the checksum fletcher32 of a chunk, as HDF5 stores it.

    For big-endian words w(1), ..., w(n) of 16 bits, the low half is the sum of all w(i) modulo 65535, and the high half
    is the sum of all (n + 1 - i) w(i) modulo 65535. A remainder of 0 is stored as 65535, unless all words are 0.
    """
    count = -(-len(chunk) // 2)
    words = np.zeros(-(-count // _ROW) * _ROW, "<u2")
    words.view(np.uint8)[: len(chunk)] = np.frombuffer(chunk, np.uint8)
    rows = words.byteswap(inplace=True).reshape(-1, _ROW)
    # The second sum weights word i of n with n - i. With i = _ROW r + c, the sums of the rows r and of the columns c
    # are enough for it, which is ten times as fast as weighting every word.
    of_row, of_column = rows.sum(axis=1, dtype=np.int64), rows.sum(axis=0, dtype=np.int64)
    total = int(of_row.sum())
    by_index = _ROW * int((np.arange(len(of_row)) % 65535 * (of_row % 65535)).sum()) + int(
        (np.arange(_ROW) * of_column).sum()
    )
    first, second = total % 65535, (count * total - by_index) % 65535
    # HDF5 folds the sums instead of dividing them: a multiple of 65535 gives 65535, or 0 if every word is 0.
    full = 65535 * bool(total)
    return (second or full) << 16 | (first or full)


def _big_endian(chunk: bytes) -> NDArray[np.int64]:
    return np.frombuffer(chunk + b"\0" * (len(chunk) % 2), ">u2").astype(np.int64)


def flipped_bit_of_chunk(raw: bytes) -> int | None:
    """Search for the bit of a chunk, or of its fletcher32 checksum, whose flip makes chunk and checksum agree.

    Parameters
    ----------
    raw : bytes
        The chunk, with the checksum in the last four bytes.

    Returns
    -------
    int or None
        Index of the bit, from the lowest bit of the first byte; None if there is no such bit.
    """
    stored, computed = int.from_bytes(raw[-4:], "little"), fletcher32(raw[:-4])
    if (stored ^ computed).bit_count() == 1:
        return 8 * (len(raw) - 4) + (stored ^ computed).bit_length() - 1
    words = _big_endian(raw[:-4])
    weights = np.arange(len(words), 0, -1)
    change = (stored & 0xFFFF) - (computed & 0xFFFF), (stored >> 16) - (computed >> 16)
    for bit in range(16):
        sign = np.where(words >> bit & 1, -1, 1)
        fits = ((sign << bit) - change[0]) % 65535 == 0
        fits &= (weights * (sign << bit) - change[1]) % 65535 == 0
        for word in np.flatnonzero(fits).tolist():
            place = 2 * word + (1 if bit < 8 else 0)
            if place < len(raw) - 4:
                return 8 * place + bit % 8
    return None
