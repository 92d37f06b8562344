"""A dataset with flipped bits or lost parts is repaired and copied by the functions of `eimi recover`."""

from __future__ import annotations

import json
import re
import runpy
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import h5py
import numpy as np
import pytest

from eimi_drivers.interfaces import Frame, SensorReading
from eimi_lab.config.calibration import load_calibration
from eimi_lab.config.specimen import load_specimen
from eimi_lab.dataset import rebuilding, recovery
from eimi_lab.dataset.layout import Header, note
from eimi_lab.dataset.logged_sensor import LoggedSensor
from eimi_lab.dataset.reading import open_dataset
from eimi_lab.dataset.recordings import Moment
from eimi_lab.dataset.repair import blocks, metadata, probing
from eimi_lab.dataset.repair.checksums import fletcher32, lookup3
from eimi_lab.dataset.repair.chunks import mend_chunks
from eimi_lab.dataset.repair.mended_file import MendedFile
from eimi_lab.dataset.repair.metadata import mend_metadata
from eimi_lab.dataset.repair.superblock import close_superblock, is_hdf5
from eimi_lab.dataset.tracked import c3d
from eimi_lab.dataset.writing import DatasetWriter
from eimi_lab.process.errors import InputError, OwnFault
from eimi_lab.process.writer_lock import only_writer

STATES = 3
SENSOR = LoggedSensor("probe", "F41", "field", "mT")


def image(number: int) -> np.ndarray:
    return np.random.default_rng(number).integers(0, 255, (24, 32)).astype(np.uint8)


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    # A folder with run.h5, a dataset of three states with two frames each, and its copy before it was closed.
    files = tmp_path_factory.mktemp("written")
    header = Header(load_specimen("type1"), load_calibration("virtual_calibration"), sensors=(SENSOR,))
    with DatasetWriter(files / "run.h5", header, Frame(image(0), 0, 0.0)) as writer:
        for k in range(STATES):
            frames = [Frame(image(2 * k + i), 2 * k + i, 0.1 * i) for i in (0, 1)]
            sensed = [{"probe": SensorReading(float(k), "mT", 2.0 * k + i)} for i in (0, 1)]
            times = [2.0 * k, 2.0 * k + 1.0]
            writer.append_state(
                frames, current_A=k / 10, field_mT=0.47 * k, time_s=times, tip_force_N=0.1, sensed=sensed
            )
        shutil.copyfile(files / "run.h5", files / "crashed.h5")
    return files


@pytest.fixture
def crashed(written: Path, tmp_path: Path) -> Path:
    # A dataset of three states whose writer did not close it.
    return Path(shutil.copy(written / "crashed.h5", tmp_path))


@pytest.fixture
def finished(written: Path, tmp_path: Path) -> Path:
    # A dataset of three states, which its writer has closed.
    return Path(shutil.copy(written / "run.h5", tmp_path))


def flipped(path: Path, *bits: int) -> Path:
    # Write a copy of a file in which some bits, counted from the beginning of the file, are flipped.
    content = bytearray(path.read_bytes())
    for bit in bits:
        content[bit // 8] ^= 1 << bit % 8
    copy = path.with_name("flipped.h5")
    copy.write_bytes(content)
    return copy


def in_chunk(path: Path, place: str, number: int) -> tuple[int, int]:
    # Return the position and the length of a chunk of an array, in bytes.
    with h5py.File(path) as file:
        chunk = file[place].id.get_chunk_info(number)
        return chunk.byte_offset, chunk.size


# Blocks of metadata


@pytest.mark.parametrize("signature", [b"OHDR", b"OCHK", b"EAHD", b"EAIB", b"EADB", b"FRHP", b"FHDB", b"BTHD", b"BTLF"])
def test_one_flipped_bit_of_each_kind_of_block_is_flipped_back(finished: Path, signature: bytes) -> None:
    raw = finished.read_bytes()
    places = [match.start() for match in re.finditer(signature, raw)]
    if not places:
        pytest.skip("HDF5 wrote no block of this kind into the small file")
    # The first is behind the address of the header of the block; the second is in the signature.
    bits = [8 * (places[-1] + 16) + 3] + ([8 * places[0] + 9] if signature in (b"OHDR", b"BTLF") else [])
    for bit in bits:
        file = MendedFile(flipped(finished, bit))
        assert mend_metadata(file) == 1
        assert file.bytes_at(0, file.size) == raw
        file.close()


def test_the_checksum_of_a_header_and_its_length_are_mended(finished: Path) -> None:
    raw = finished.read_bytes()
    headers = [match.start() for match in re.finditer(b"OHDR", raw)]
    for at in headers[:2]:
        flags = raw[at + 5]
        place = at + 6 + (16 if flags & 0x20 else 0) + (4 if flags & 0x10 else 0)
        width = 1 << (flags & 3)
        length = place - at + width + int.from_bytes(raw[place : place + width], "little") + 4
        assert lookup3(raw[at : at + length - 4]) == int.from_bytes(raw[at + length - 4 : at + length], "little")
        for bit in (8 * place + 2, 8 * (at + length - 1) + 7):
            file = MendedFile(flipped(finished, bit))
            assert mend_metadata(file) == 1
            assert file.bytes_at(0, file.size) == raw
            file.close()


@pytest.mark.parametrize(
    ("flags", "at", "width"),
    [(0x00, 6, 1), (0x01, 6, 2), (0x02, 6, 4), (0x03, 6, 8), (0x10, 10, 1), (0x20, 22, 1), (0x33, 26, 8)],
)
def test_the_length_of_a_header_is_after_its_times_and_its_numbers_of_attributes(
    flags: int, at: int, width: int
) -> None:
    # HDF5 File Format Specification 3.0, IV.A.1.b: four times of 4 bytes with flag 0x20, two numbers with flag 0x10.
    head = b"OHDR" + bytes([2, flags]) + bytes(at - 6) + (40).to_bytes(width, "little") + bytes(40)
    assert metadata._header_length(head) == at + width + 40 + 4
    assert metadata._header_length(b"OHDR" + bytes([1, flags]) + head[6:]) == 0
    assert metadata._header_length(head[:33]) == 0
    assert metadata._header_length(head[:34]) > 0


@pytest.mark.parametrize("flags", [0, 4])
def test_the_blocks_that_continue_a_header_are_found(flags: int) -> None:
    prefix = 6 if flags else 4
    blocks = [(7, b"abc"), (16, (1234).to_bytes(8, "little") + (56).to_bytes(8, "little")), (1, b"")]
    blocks.append((16, (99).to_bytes(8, "little") + (8).to_bytes(8, "little")))
    messages = b"".join(
        bytes([kind]) + len(body).to_bytes(2, "little") + bytes(prefix - 3) + body for kind, body in blocks
    )
    assert list(metadata._continuations(messages, flags)) == [(1234, 56), (99, 8)]
    assert list(metadata._continuations(b"", flags)) == []


def test_a_block_of_names_without_a_readable_heap_is_left_alone(tmp_path: Path) -> None:
    content = b"FHDB\0" + (20).to_bytes(8, "little") + bytes(7) + b"FRHP" + bytes(200)
    (tmp_path / "heap.bin").write_bytes(content)
    file = MendedFile(tmp_path / "heap.bin")
    assert metadata._mend_heap(file, 0) == 0  # the heap has no checksums of its names
    assert metadata._mend_heap(file, 60) == 0  # the heap would be outside the file
    assert file.patches == {}
    file.close()


@pytest.mark.parametrize(("bits", "begins"), [(32, 17), (33, 18), (16, 15)])
@pytest.mark.parametrize("wrong", ["name", "checksum", "nothing", "two bits"])
def test_a_flipped_bit_in_the_names_of_a_heap_is_flipped_back(
    tmp_path: Path, bits: int, begins: int, wrong: str
) -> None:
    # III.G: 4 + 1 + 8 bytes, the offset in the heap (as many bits as the heap says), the checksum, and the names.
    before = b"FHDB\0" + (100).to_bytes(8, "little") + bytes(begins - 13)
    names = b"left and right edges of the beam"
    block = before + lookup3(before + bytes(4) + names).to_bytes(4, "little") + names
    header = bytearray(146)
    header[9], header[128] = 2, bits
    header[112:120] = len(block).to_bytes(8, "little")
    sound = block + bytes(100 - len(block)) + bytes(header)
    path = tmp_path / "heap.bin"
    path.write_bytes(sound)
    flips = {"name": [8 * (begins + 9) + 2], "checksum": [8 * begins + 5], "nothing": []}.get(wrong, [8 * 40, 8 * 44])
    file = MendedFile(flipped(path, *flips) if flips else path)
    assert metadata._mend_heap(file, 0) == (wrong in ("name", "checksum"))
    assert (file.bytes_at(0, len(sound)) == sound) == (wrong != "two bits")
    file.close()


class Bytes:
    # A file in memory.

    def __init__(self, content: bytes) -> None:
        self.content = content

    def bytes_at(self, at: int, length: int) -> bytes:
        return self.content[at : at + length]


def message(kind: int, body: bytes) -> bytes:
    return bytes([kind]) + len(body).to_bytes(2, "little") + b"\0" + body


def pointer(address: int, length: int) -> bytes:
    # Return the message of a header that names a block which continues it.
    return message(0x10, address.to_bytes(8, "little") + length.to_bytes(8, "little"))


def test_each_block_that_continues_a_header_is_mended_once(monkeypatch: pytest.MonkeyPatch) -> None:
    # The header names the blocks at 100 and 200; the block at 100 names that at 300, which names that at 100 again.
    head = pointer(100, 30) + pointer(200, 30)
    header = b"OHDR" + bytes([2, 0, len(head)]) + head + b"sums"
    content = bytearray(400)
    content[: len(header)] = header
    content[100:130] = b"OCHK" + pointer(300, 29) + b"x" * 2 + b"sums"
    content[200:230] = b"OCHK" + pointer(350, 29) + b"x" * 2 + b"sums"
    content[300:329] = b"OCHK" + pointer(100, 30) + b"x" + b"sums"
    asked: list[tuple[int, int]] = []
    outcome = {100: True, 200: False, 300: None}
    monkeypatch.setattr(metadata, "is_sound", lambda file, at, length: length == len(header))
    monkeypatch.setattr(metadata, "mend_block", lambda file, at, length: asked.append((at, length)) or outcome[at])
    assert metadata._mend_header(Bytes(bytes(content)), 0) == 1  # type: ignore[arg-type]
    assert sorted(asked) == [(100, 30), (200, 30), (300, 29)]
    outcome[300] = True
    assert metadata._mend_header(Bytes(bytes(content)), 0) == 2  # type: ignore[arg-type]


def test_a_header_without_a_right_checksum_is_left_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[int] = []
    monkeypatch.setattr(metadata, "is_sound", lambda file, at, length: asked.append(length))
    monkeypatch.setattr(metadata, "mend_block", lambda file, at, length: asked.append(length))
    header = b"OHDR" + bytes([2, 0, 40]) + bytes(60)
    assert metadata._mend_header(Bytes(header), 0) == 0  # type: ignore[arg-type]
    # A flip in the length 40 gives 41, 42, 44, 32, 56, 8, 104 or 168; a flip in the flags gives a length of 4 bytes, or
    # a place of the length behind two numbers or behind four times.
    assert asked[: len(asked) // 2] == asked[len(asked) // 2 :] == sorted(set(asked))
    assert {51, 52, 53, 55, 43, 67, 19, 115, 179} <= set(asked)
    assert {54, 15, 27} <= set(asked)
    assert 0 in asked


@pytest.mark.parametrize(
    ("sound", "mended", "outcome"), [([30], [20], (0, 30)), ([], [20, 30], (1, 20)), ([], [], (0, 0))]
)
def test_a_sound_length_is_preferred_to_a_mended_one(
    monkeypatch: pytest.MonkeyPatch, sound: list[int], mended: list[int], outcome: tuple[int, int]
) -> None:
    monkeypatch.setattr(metadata, "is_sound", lambda file, at, length: length in sound)
    monkeypatch.setattr(metadata, "mend_block", lambda file, at, length: length in mended)
    assert metadata._mend_any(Bytes(b""), 5, [20, 30]) == outcome  # type: ignore[arg-type]


def heap(names: bytes, *, flags: int = 2, length: int | None = None, bits: int = 17) -> tuple[bytearray, int]:
    # Return a file with the header of a heap at 0 and a block of names at 200, and the place of the checksum.
    # HDF5 File Format Specification 3.0, III.G: the size of the block is in bytes 112 to 119, and the number of bits of
    # an address in the heap is in byte 128; the checksum is behind the signature, a version (1 byte), an address (8
    # bytes) and the offset of the block.
    header = bytearray(146)
    place = 13 + -(-bits // 8)
    block = bytearray(b"FHDB\0" + bytes(8) + bytes(place - 13) + bytes(4) + names)
    header[9], header[128] = flags, bits
    header[112:120] = (len(block) if length is None else length).to_bytes(8, "little")
    block[place : place + 4] = lookup3(bytes(block)).to_bytes(4, "little")
    return bytearray(header + bytes(54) + block), 200 + place


@pytest.mark.parametrize("bits", [16, 17, 24, 25])
def test_the_checksum_of_names_is_behind_the_offset_of_their_block(tmp_path: Path, bits: int) -> None:
    sound, place = heap(b"abcdefgh", bits=bits)
    for flip, count in ((None, 0), (8 * place + 5, 1), (8 * (place + 3) + 7, 1), (8 * (place + 6) + 2, 1)):
        raw = bytearray(sound)
        if flip is not None:
            raw[flip // 8] ^= 1 << flip % 8
        path = tmp_path / "heap"
        path.write_bytes(raw)
        file = MendedFile(path)
        assert metadata._mend_signed(file, 200, b"FHDB") == count
        assert file.bytes_at(0, file.size) == bytes(sound)
        file.close()


@pytest.mark.parametrize("change", [{"flags": 0}, {"flags": 1}, {"length": 25}, {"length": 20}, {"length": 1 << 20}])
def test_names_without_a_checksum_or_with_a_wrong_length_are_left_alone(tmp_path: Path, change: dict[str, int]) -> None:
    raw, place = heap(b"abcdefgh", **change)
    raw[place + 5] ^= 1
    path = tmp_path / "heap"
    path.write_bytes(raw)
    file = MendedFile(path)
    assert metadata._mend_signed(file, 200, b"FHDB") == 0
    assert file.bytes_at(0, file.size) == bytes(raw)
    file.close()


@pytest.mark.parametrize(
    ("signature", "lengths"), [(b"EAHD", [72]), (b"FRHP", [146]), (b"BTHD", [38]), (b"BTLF", list(range(21, 517, 11)))]
)
def test_blocks_of_a_fixed_kind_have_their_lengths(signature: bytes, lengths: list[int]) -> None:
    assert metadata._block_lengths(Bytes(b""), 0, signature) == lengths  # type: ignore[arg-type]


@pytest.mark.parametrize("broken", [9, 10, None])
def test_blocks_of_an_array_without_a_readable_header_have_no_length(broken: int | None) -> None:
    # EAIB at 0 points to the header at 14, whose bytes 6 to 10 are not 0; without `broken`, its last byte is missing.
    sizes = bytes([8, 32, 4, 16, 4])
    content = bytearray(b"EAIB" + bytes(2) + (14).to_bytes(8, "little") + bytes(6) + sizes + bytes(61))
    assert len(content) == 14 + 72
    assert metadata._block_lengths(Bytes(bytes(content)), 0, b"EAIB")  # type: ignore[arg-type]
    if broken is None:
        del content[-1]
    else:
        content[14 + broken] = 0
    assert metadata._block_lengths(Bytes(bytes(content)), 0, b"EAIB") == []  # type: ignore[arg-type]


def test_the_blocks_of_an_extensible_array_have_the_lengths_of_the_specification() -> None:
    # HDF5 File Format Specification 3.0, VII.D: elements of 8 bytes, 32 bits for their number, 4 elements in the index
    # block, at least 16 elements in a data block, at least 4 data block pointers in a secondary block.
    content = b"EAIB" + bytes(2) + (14).to_bytes(8, "little") + bytes(6) + bytes([8, 32, 4, 16, 4]) + bytes(61)
    # 1 + 32 - 4 = 29 secondary blocks; the first 2 log2 4 = 4 have their 2 (4 - 1) = 6 data blocks in the index block.
    expected = 14 + 4 * 8 + 8 * 6 + 8 * (29 - 4) + 4
    assert metadata._block_lengths(Bytes(content), 0, b"EAIB") == [expected]  # type: ignore[arg-type]
    content = b"EADB" + content[4:]
    expected_data = [14 + 4 + 8 * 16 * 2**doubled + 4 for doubled in range(8)]
    assert metadata._block_lengths(Bytes(content), 0, b"EADB") == expected_data  # type: ignore[arg-type]


def test_a_mended_file_is_read_from_its_beginning(tmp_path: Path) -> None:
    (tmp_path / "file.bin").write_bytes(b"0123456789")
    file = MendedFile(tmp_path / "file.bin")
    file.patch(1, b"ab")
    assert file.tell() == 0
    assert file.read(4) == b"0ab3"
    assert file.read() == b"456789"
    assert file.seek(-2, 2) == 8
    assert file.seek(-1, 1) == 7
    assert file.read(9) == b"789"
    assert file.bytes_at(-1, 2) == b""
    file.close()


def test_sound_metadata_are_left_alone(finished: Path) -> None:
    file = MendedFile(finished)
    assert mend_metadata(file) == 0
    assert (file.patches, file.searched_bytes) == ({}, 0)
    file.close()


def test_two_damaged_blocks_are_both_mended(finished: Path) -> None:
    raw = finished.read_bytes()
    headers = [match.start() for match in re.finditer(b"OHDR", raw)]
    file = MendedFile(flipped(finished, 8 * (headers[0] + 20) + 1, 8 * (headers[3] + 20) + 1))
    assert mend_metadata(file) == 2
    assert file.bytes_at(0, file.size) == raw
    file.close()


def block_in(path: Path, content: bytes) -> MendedFile:
    path.write_bytes(b"before" + content + b"behind")
    return MendedFile(path)


@pytest.mark.parametrize(("length", "possible"), [(8, False), (9, True), (16_384, True), (16_385, False)])
def test_a_block_has_9_to_16384_bytes(tmp_path: Path, length: int, possible: bool) -> None:
    body = bytes(range(256)) * 65
    block = body[: length - 4] + lookup3(body[: length - 4]).to_bytes(4, "little")
    file = block_in(tmp_path / "block", block)
    assert blocks.is_sound(file, 6, length) is possible
    assert blocks.mend_block(file, 6, length) is (None if possible else False)
    file.patch(6, bytes([block[0] ^ 1]))
    assert not blocks.is_sound(file, 6, length)
    file.close()


def test_a_block_is_mended_or_its_search_is_counted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    body = bytes(range(40))
    block = body + lookup3(body).to_bytes(4, "little")
    file = block_in(tmp_path / "block", block)
    file.patch(6 + 41, bytes([block[41] ^ 16]))  # in the checksum
    assert blocks.mend_block(file, 6, 44) is True
    assert file.bytes_at(6, 44) == block
    file.patch(6 + 10, bytes([block[10] ^ 16]))
    assert blocks.mend_block(file, 6, 44) is True
    assert file.bytes_at(6, 44) == block
    assert file.searched_bytes == 0
    file.patch(6 + 10, bytes([block[10] ^ 3]))  # two bits
    assert blocks.mend_block(file, 6, 44) is False
    assert file.searched_bytes == 8 * 40**2
    monkeypatch.setattr(blocks, "MOST_SEARCHED_BYTES", 2 * 8 * 40**2)
    file.patch(6 + 10, bytes([block[10] ^ 1]))
    assert blocks.mend_block(file, 6, 44) is True
    file.searched_bytes += 1
    file.patch(6 + 10, bytes([block[10] ^ 1]))
    assert blocks.mend_block(file, 6, 44) is False  # too much was searched already
    assert blocks.mend_block(file, 20, 44) is False  # the file ends before
    file.close()


# Chunks and the superblock


def test_a_flipped_bit_of_a_chunk_or_of_its_checksum_is_flipped_back(finished: Path) -> None:
    raw = finished.read_bytes()
    at, size = in_chunk(finished, "entry/data/frames", 1)
    assert fletcher32(raw[at : at + size - 4]) == int.from_bytes(raw[at + size - 4 : at + size], "little")
    for bit in (8 * at, 8 * at + 15, 8 * (at + 77) + 3, 8 * (at + size - 1) + 7, 8 * (at + size - 4)):
        file = MendedFile(flipped(finished, bit))
        with h5py.File(file, "r") as opened:
            assert mend_chunks(file, opened["entry/data/time"]) == 0
            assert mend_chunks(file, opened["entry/data/frames"]) == 1
        assert file.patches == {bit // 8: raw[bit // 8]}
        file.close()
    file = MendedFile(flipped(finished, 8 * at + 1, 8 * at + 90))  # two bits cannot be found
    with h5py.File(file, "r") as opened:
        assert mend_chunks(file, opened["entry/data/frames"]) == 0
        assert mend_chunks(file, opened["entry/title"]) == 0
    file.close()


def test_a_file_that_was_never_closed_is_marked_as_closed(crashed: Path, finished: Path) -> None:
    # Byte 11 of the superblock is the mark, and byte 28 begins the end of the file (HDF5 File Format, II.A).
    file = MendedFile(crashed)
    assert crashed.read_bytes()[11] != 0
    close_superblock(file)
    head = file.bytes_at(0, 48)
    assert head[:11] == b"\x89HDF\r\n\x1a\n\x03\x08\x08"
    assert head[11] == 0
    assert int.from_bytes(head[28:36], "little") == file.size == crashed.stat().st_size
    assert int.from_bytes(head[44:], "little") == lookup3(head[:44])
    with h5py.File(file, "r") as opened:
        assert len(opened["entry/states/index"]) == STATES
    damaged = MendedFile(flipped(finished, 8 * 2 + 1, 8 * 9))
    close_superblock(damaged)
    assert damaged.bytes_at(0, 28) == finished.read_bytes()[:28]
    for opened_file in (file, damaged):
        opened_file.close()


@pytest.mark.parametrize(
    ("content", "recognised"),
    [
        (b"\x89HDFxxxx" + bytes(40), True),
        (b"\x89HDxxxxx" + bytes(40), False),
        (b"\x89HDFxxxx" + bytes(39), False),
        (bytes(60) + b"OHDR" + bytes(9), True),
        (bytes(100), False),
        (b"", False),
    ],
)
def test_half_of_the_signature_or_a_header_shows_an_hdf5_file(tmp_path: Path, content: bytes, recognised: bool) -> None:
    path = tmp_path / "x.h5"
    path.write_bytes(content)
    file = MendedFile(path)
    assert is_hdf5(file) is recognised
    file.close()


def test_a_mended_file_is_read_like_a_file(tmp_path: Path) -> None:
    path = tmp_path / "x"
    path.write_bytes(bytes(range(10)))
    file = MendedFile(path)
    file.patch(3, b"ab")
    file.flip(0, 8 * 9 + 1)
    assert file.bytes_at(2, 4) == b"\x02ab\x05"
    assert file.bytes_at(8, 9) == bytes([8, 9 ^ 2])
    assert file.bytes_at(5, 3) == bytes([5, 6, 7])
    assert (file.bytes_at(-1, 4), file.bytes_at(10, 4)) == (b"", b"")
    assert (file.seek(4), file.tell()) == (4, 4)
    assert file.read(2) == b"b\x05"
    assert (file.seek(-1, 1), file.seek(-2, 2)) == (5, 8)
    buffer = bytearray(b"xxxx")
    assert file.readinto(memoryview(buffer)) == 2
    assert (bytes(buffer), file.tell()) == (bytes([8, 9 ^ 2]) + b"xx", 10)
    assert (file.readable(), file.seekable()) == (True, True)
    assert list(file.find(re.compile(b"[\x01\x02\x09]"))) == [1, 2, 9]
    assert path.read_bytes() == bytes(range(10))
    file.close()
    assert file.closed
    file.close()


# Copies of what is readable


def copied(path: Path) -> tuple[Any, list[str]]:
    # Return an open copy of what is readable, and the lines about what was corrected or lost.
    copy = path.with_name("copy.h5")
    states, lines = recovery.copy_readable(path, copy)
    dataset = open_dataset(copy)
    assert len(dataset.states) == states
    return dataset, lines


def test_a_crashed_dataset_is_copied_whole(crashed: Path) -> None:
    dataset, lines = copied(crashed)
    with dataset:
        assert lines == []
        assert [state.current_A for state in dataset.states] == [0.0, 0.1, 0.2]
        assert [state.tip_force_N for state in dataset.states] == [0.1] * 3
        for k in range(STATES):
            np.testing.assert_array_equal(dataset.images(k), [image(2 * k), image(2 * k + 1)])
        (log,) = dataset.sensors()
        np.testing.assert_allclose(log.value, [0, 0, 1, 1, 2, 2])
    with h5py.File(crashed.with_name("copy.h5")) as file:
        assert file.attrs["default"] == "entry"
        assert file["entry/data"].attrs["signal"] == "frames"
        detector = h5py.h5o.get_info(file["entry/instrument/detector/data"].id).addr
        assert detector == h5py.h5o.get_info(file["entry/data/frames"].id).addr  # one array with two names


def test_flipped_bits_are_counted_in_the_report(finished: Path) -> None:
    at, _ = in_chunk(finished, "entry/data/frames", 2)
    header = finished.read_bytes().index(b"OHDR")
    dataset, lines = copied(flipped(finished, 8 * (at + 5), 8 * (header + 20)))
    with dataset:
        assert lines == ["single flipped bits in the file that were corrected: 2"]
        np.testing.assert_array_equal(dataset.images(1)[0], image(2))


def test_damaged_frames_are_left_out_and_their_states_are_flagged(finished: Path) -> None:
    # The second frame of state 0 and both frames of state 1 are damaged beyond a single bit.
    places = [in_chunk(finished, "entry/data/frames", number)[0] for number in (1, 2, 3)]
    dataset, lines = copied(flipped(finished, *(8 * at + bit for at in places for bit in (1, 90))))
    with dataset:
        assert lines == [
            "damaged frames left out: 3, of state 0, 1 (counted from 0); these states get the flag DROPPED"
        ]
        flags = [[(flag.name, flag.value) for flag in state.flags] for state in dataset.states]
        assert flags == [[("DROPPED", 1.0)], [("DROPPED", 2.0)], []]
        np.testing.assert_array_equal(dataset.images(0), [image(0)])
        np.testing.assert_array_equal(dataset.images(1), [np.zeros((24, 32))])
        np.testing.assert_array_equal(dataset.images(2), [image(4), image(5)])
        np.testing.assert_allclose(dataset.times_of_states(), [0.0, 2.0, 4.5])
        (log,) = dataset.sensors()
        np.testing.assert_allclose(log.value, [0, 1, 2, 2])


def add_protocol(path: Path, texts: dict[str, str]) -> None:
    # Add a protocol with a tip force of 0.25 N to a dataset, so that it looks like the dataset of a run.
    text = texts["protocol"].replace("frames_per_state = 2", "frames_per_state = 2\ntip_force_N = 0.25")
    with h5py.File(path, "r+") as file:
        note(file["entry"], "protocol", text, "application/toml")


def test_damaged_columns_of_the_states_are_rebuilt_from_frames_and_protocol(
    finished: Path, texts: dict[str, str]
) -> None:
    add_protocol(finished, texts)
    places = [in_chunk(finished, f"entry/states/{name}", 0)[0] for name in ("current", "tip_force", "flags")]
    dataset, lines = copied(flipped(finished, *(8 * at + bit for at in places for bit in (1, 90))))
    with dataset:
        assert [state.current_A for state in dataset.states] == [0.0, 0.1, 0.2]
        assert [state.tip_force_N for state in dataset.states] == [0.25] * 3
        assert lines == [
            "unreadable and left out: entry/states/current (rebuilt from the frames), "
            "entry/states/tip_force (rebuilt from the protocol), "
            "entry/states/flags (lost; the states have no flags now)"
        ]


def test_lost_tip_forces_of_imported_pictures_are_not_invented(finished: Path) -> None:
    at, _ = in_chunk(finished, "entry/states/tip_force", 0)
    damaged = flipped(finished, 8 * at + 1, 8 * at + 90)
    with pytest.raises(InputError, match=r"the tip forces of its states are damaged; repeat the import"):
        recovery.copy_readable(damaged, finished.with_name("copy.h5"))


def test_rows_of_a_state_that_was_not_stored_completely_are_left_out(finished: Path) -> None:
    with h5py.File(finished, "r+") as file:
        file["entry/states/index"].resize(2, axis=0)
    dataset, lines = copied(finished)
    with dataset:
        assert lines == []
        assert len(dataset.states) == 2
        (log,) = dataset.sensors()
        assert len(log.value) == 4
    with h5py.File(finished.with_name("copy.h5")) as file:
        assert len(file["entry/data/frames"]) == len(file["entry/data/time"]) == 4
        assert len(file["entry/states/flags"]) == 2


class Broken:
    # A group of HDF5 of which some members, or the attributes, cannot be read.

    def __init__(self, group: h5py.Group, *broken: str) -> None:
        self.group, self.broken, self.name, self.id = group, broken, group.name, group.id

    def __iter__(self) -> Any:
        return iter(self.group)

    def get(self, name: str, getlink: bool) -> Any:
        return self.group.get(name, getlink=getlink)

    def __getitem__(self, name: str) -> Any:
        if name in self.broken:
            raise KeyError("wrong checksum")
        return self.group[name]

    @property
    def attrs(self) -> Any:
        if "attributes" in self.broken:
            raise OSError("wrong checksum")
        return self.group.attrs


@pytest.fixture
def two_groups() -> Iterator[tuple[h5py.Group, h5py.Group]]:
    with h5py.File("memory.h5", "w", driver="core", backing_store=False) as file:
        source, copy = file.create_group("source"), file.create_group("copy")
        source.attrs["units"] = "mm"
        source["a"], source["b"], source["c/d"] = [1, 2], [3], [4]
        source["e"], source["c/f"] = source["a"], source["c"]
        yield source, copy


def test_a_group_is_copied_with_its_attributes_and_further_names(two_groups: tuple[h5py.Group, h5py.Group]) -> None:
    source, copy = two_groups
    lost: list[str] = []
    recovery._copy_group(source, copy, lost, {h5py.h5o.get_info(source.id).addr: "/copy"})
    assert lost == []
    assert dict(copy.attrs) == {"units": "mm"}
    assert [copy[name][()].tolist() for name in ("a", "b", "c/d", "e")] == [[1, 2], [3], [4], [1, 2]]
    for one, other in (("a", "e"), ("c", "c/f")):
        assert h5py.h5o.get_info(copy[one].id).addr == h5py.h5o.get_info(copy[other].id).addr
    assert h5py.h5o.get_info(copy["a"].id).addr != h5py.h5o.get_info(source["a"].id).addr


def test_a_member_that_cannot_be_read_is_left_out_and_named(two_groups: tuple[h5py.Group, h5py.Group]) -> None:
    source, copy = two_groups
    lost: list[str] = []
    recovery._copy_group(Broken(source, "a", "attributes"), copy, lost, {})  # type: ignore[arg-type]
    assert lost == ["attributes of /source", "/source/a"]
    assert sorted(copy) == ["b", "c", "e"]
    assert dict(copy.attrs) == {}


def test_a_member_that_is_copied_in_part_is_left_out(
    two_groups: tuple[h5py.Group, h5py.Group], monkeypatch: pytest.MonkeyPatch
) -> None:
    source, copy = two_groups

    def copy_in_part(of: Any, name: bytes, to: Any, as_name: bytes) -> None:
        h5py.h5g.create(to, as_name)
        raise RuntimeError("wrong checksum")

    monkeypatch.setattr(recovery.h5py.h5o, "copy", copy_in_part)
    lost: list[str] = []
    recovery._copy_group(source, copy, lost, {})
    assert lost == ["/source/a", "/source/b", "/source/c/d", "/source/e"]
    assert list(copy) == ["c"]
    assert list(copy["c"]) == ["f"]


@pytest.mark.parametrize("missing", ["data/frames", "states"])
def test_columns_are_rebuilt_only_from_frames_and_for_states(finished: Path, missing: str) -> None:
    with h5py.File(finished, "r+") as file:
        entry = file["entry"]
        del entry["states/current"]
        del entry[missing]
        assert rebuilding.rebuilt_tables(entry, ["/entry/x"], finished) == ["/entry/x"]
        assert "states/current" not in entry


def test_each_column_of_the_states_is_rebuilt(finished: Path, texts: dict[str, str]) -> None:
    sources = {
        "current": "rebuilt from the frames",
        "field": "rebuilt from the frames",
        "flags": "lost; the states have no flags now",
        "index": "rebuilt from the frames",
        "tip_force": "rebuilt from the protocol",
    }
    add_protocol(finished, texts)
    with h5py.File(finished, "r+") as file:
        entry = file["entry"]
        assert rebuilding.rebuilt_tables(entry, [], finished) == []
        before = {name: entry["states"][name][()] for name in sources}
        kinds = {name: (entry["states"][name].dtype, entry["states"][name].maxshape) for name in sources}
        for name in sources:
            del entry["states"][name]
        assert sorted(rebuilding.rebuilt_tables(entry, [], finished)) == [
            f"entry/states/{name} ({source})" for name, source in sources.items()
        ]
        for name in sources:
            expected = np.full(3, 0.25) if name == "tip_force" else before[name]
            np.testing.assert_array_equal(entry["states"][name][()], expected)
            assert (entry["states"][name].dtype, entry["states"][name].maxshape) == kinds[name]


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (
            MemoryError(),
            r"run\.h5: cannot be read with the memory that `eimi recover` may use; use a computer with more",
        ),
        (OSError("own"), "^own$"),
    ],
)
def test_too_little_memory_is_named_and_an_own_error_is_passed_on(
    finished: Path, monkeypatch: pytest.MonkeyPatch, error: Exception, words: str
) -> None:
    def fail(*given: Any) -> None:
        raise error

    monkeypatch.setattr(recovery, "_copy", fail)
    kind = InputError if isinstance(error, MemoryError) else OSError
    with pytest.raises(kind, match=words):
        recovery._attempt(MendedFile(finished), finished, finished.with_name("copy.h5"))


def test_points_without_frames_are_read_before_they_count_as_recovered(
    finished: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    read: list[str] = []
    monkeypatch.setattr(recovery.Dataset, "points", lambda self: read.append(self._if_damaged))
    with h5py.File(finished, "r+") as file:
        del file["entry/data/frames"]
        del file["entry/instrument/detector"]
    states, _ = recovery.copy_readable(finished, finished.with_name("copy.h5"))
    assert states == 3
    assert read == ["the part of the file that can be read is not a dataset"]


def test_links_and_other_files_are_left_out_and_named(finished: Path) -> None:
    with h5py.File(finished, "r+") as file:
        file["entry/soft"] = h5py.SoftLink("/entry/title")
        file.create_dataset("entry/outside", (8,), "f8", external=[("/etc/passwd", 0, 64)])
    dataset, lines = copied(finished)
    dataset.close()
    assert lines == [
        "unreadable and left out: /entry/outside (kept in another file), /entry/soft (a link to another place)"
    ]
    with h5py.File(finished.with_name("copy.h5")) as file:
        assert "soft" not in file["entry"]
        assert "outside" not in file["entry"]


def recorded(folder: Path) -> Path:
    # Return a closed dataset with three frames of a recording while the beam settled.
    protocol: Any = SimpleNamespace(
        transients=SimpleNamespace(frames_per_state=4),
        ring_down=None,
        conditioning=None,
        creep=False,
        text="name = 'n'",
    )
    header = Header(load_specimen("type1"), load_calibration("virtual_calibration"), protocol)
    with DatasetWriter(folder / "recorded.h5", header, Frame(image(0), 0, 0.0)) as writer:
        moments = [Moment(Frame(image(10 + k), k, 0.0), 0.1 * k, 0.1 * k, 0.0) for k in range(3)]
        writer.append_state([Frame(image(0), 0, 0.0)], current_A=0.0, field_mT=0.0, transient=moments)
    return folder / "recorded.h5"


def test_damaged_frames_of_a_recording_are_left_out(tmp_path: Path) -> None:
    path = recorded(tmp_path)
    at, _ = in_chunk(path, "entry/transients/frames", 1)
    dataset, lines = copied(flipped(path, 8 * at + 1, 8 * at + 90))
    with dataset:
        assert lines == ["damaged frames left out of transients: 1"]
        transient = dataset.transient(0)
        np.testing.assert_array_equal(transient.images, [image(10), image(12)])
        np.testing.assert_allclose(transient.time_s, [0.0, 0.2])
    at, _ = in_chunk(path, "entry/transients/state", 0)
    dataset, lines = copied(flipped(path, 8 * at + 1, 8 * at + 90))
    with dataset:
        assert lines == ["unreadable and left out: entry/transients"]
        assert dataset.transient(0) is None


def test_what_cannot_be_read_at_all_is_refused(finished: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    other = finished.with_name("other.h5")
    other.write_bytes(b"text" * 100)
    with pytest.raises(InputError, match=r"other\.h5: is not an HDF5 file"):
        recovery.copy_readable(other, finished.with_name("copy.h5"))
    with h5py.File(other, "w", libver=("v110", "latest")) as file:
        file["x"] = 1
    with pytest.raises(InputError, match=r"other\.h5: is damaged \(.*entry"):
        recovery.copy_readable(other, finished.with_name("copy.h5"))

    def fail(*_: object) -> None:
        raise MemoryError

    monkeypatch.setattr(recovery, "_copy", fail)
    with pytest.raises(InputError, match=r"run\.h5: cannot be read with the memory that `eimi recover` may use"):
        recovery.copy_readable(finished, finished.with_name("copy.h5"))

    def wrong(*_: object) -> None:
        raise ValueError("a fault of this program")

    monkeypatch.setattr(recovery, "_copy", wrong)
    with pytest.raises(ValueError, match="a fault of this program"):
        recovery.copy_readable(finished, finished.with_name("copy.h5"))


def test_a_file_that_is_being_written_is_read_beside_its_writer(crashed: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    opened: list[dict[str, Any]] = []
    monkeypatch.setattr(recovery, "_copy", lambda source, *paths: (opened.append({"swmr": source.swmr_mode}), paths)[1])
    copy = crashed.with_name("copy.h5")
    assert recovery.copy_readable(crashed, copy, running=True) == (crashed, copy)
    assert opened == [{"swmr": True}]


# The other process


def test_the_outcome_of_the_other_process_is_passed_on(
    finished: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    asked: list[Any] = []
    answer = SimpleNamespace(returncode=0, stdout=json.dumps({"states": 2, "said": ["a", "b"]}).encode(), stderr=b"")

    def run(path: Path, command: list[str], within_s: float) -> Any:
        asked.append((path, command[:-1], within_s))
        Path(command[-1]).write_bytes(b"copy")
        return answer

    monkeypatch.setattr(recovery, "run_limited", run)
    said: list[str] = []
    target = finished.with_name("whole.h5")
    assert recovery.recover(finished, target, say=said.append) == 2
    assert said == [f"{finished}: a", f"{finished}: b"]
    assert target.read_bytes() == b"copy"
    within_s = 60.0 + finished.stat().st_size / 2e6
    command = [sys.executable, "-P", "-m", "eimi_lab.dataset.recovery", str(finished), "ended"]
    assert asked == [(finished, command, within_s)]
    with only_writer(finished):
        recovery.recover(finished, target, force=True)
        recovery.recover(finished, finished, force=True)
    assert [command[-1] for _, command, _ in asked[1:]] == ["running", "ended"]
    with pytest.raises(InputError, match=r"whole\.h5: exists already"):
        recovery.recover(finished, target)
    answer.returncode, answer.stderr = 2, b"warning\nrun.h5: is damaged\n"
    with pytest.raises(InputError, match=r"^run\.h5: is damaged$"):
        recovery.recover(finished, target, force=True)
    answer.returncode = 1
    with pytest.raises(OwnFault, match=r"run\.h5: its recovery failed: run\.h5: is damaged: a fault of this program"):
        recovery.recover(finished, target, force=True)
    with pytest.raises(InputError, match=r"is a folder; give a dataset to recover"):
        recovery.recover(tmp_path, target)
    with pytest.raises(InputError, match=r"nothing\.h5: is not a file; give a dataset to recover"):
        recovery.recover(tmp_path / "nothing.h5", target)


def test_the_other_process_limits_itself_and_prints_its_outcome(
    finished: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    limits: list[Any] = []
    monkeypatch.setattr(recovery, "obey_processor_limit", limits.append)
    monkeypatch.setattr(recovery, "limit_memory", limits.append)
    recovery._main(finished, "ended", finished.with_name("copy.h5"), "60")
    assert json.loads(capsys.readouterr().out) == {"states": 3, "said": []}
    assert limits == ["60", (4 << 30) + finished.stat().st_size]
    finished.write_bytes(b"text" * 100)
    with pytest.raises(SystemExit) as caught:
        recovery._main(finished, "ended", finished.with_name("copy.h5"), "60")
    assert caught.value.code == 2
    assert "is not an HDF5 file" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("program", "more"),
    [(recovery, ["ended", "copy.h5"]), (probing, []), (c3d, [])],
    ids=["recovery", "probing", "c3d"],
)
def test_the_program_of_another_process_limits_itself_before_it_reads(
    finished: Path, monkeypatch: pytest.MonkeyPatch, capsysbinary: Any, program: Any, more: list[str]
) -> None:
    limited: list[Any] = []

    def read(*_: Any, **__: Any) -> Any:
        limited.append("read")
        raise MemoryError

    monkeypatch.setattr("eimi_lab.process.limits.obey_processor_limit", lambda limit: limited.append(("time", limit)))
    monkeypatch.setattr("eimi_lab.process.limits.limit_memory", lambda limit: limited.append("memory"))
    monkeypatch.setattr(h5py, "File", read)
    monkeypatch.setattr("eimi_lab.dataset.repair.superblock.is_hdf5", read)
    monkeypatch.setitem(sys.modules, "ezc3d", SimpleNamespace(c3d=read))
    monkeypatch.setattr(
        sys, "argv", ["program", str(finished), *(str(finished.with_name(name)) for name in more), "77"]
    )
    with pytest.raises((MemoryError, SystemExit)):
        runpy.run_path(program.__file__, run_name="__main__")
    memory = ["memory"] * (program is not probing)
    assert limited == [("time", "77"), *memory, "read"]
    limited.clear()
    monkeypatch.setattr(sys, "argv", ["program", str(finished)])
    with pytest.raises(SystemExit) as caught:
        runpy.run_path(program.__file__, run_name="__main__")
    assert (caught.value.code, limited) == (2, [])


def test_a_file_is_probed_in_another_process(crashed: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Any] = []
    answer = SimpleNamespace(returncode=0, stderr=b"")
    monkeypatch.setattr(probing, "run_limited", lambda *given: (asked.append(given), answer)[1])
    assert probing.why_unreadable(crashed) == ""
    command = [sys.executable, "-P", "-m", "eimi_lab.dataset.repair.probing", str(crashed)]
    assert asked == [(crashed, command, 15.0)]
    answer.returncode, answer.stderr = 1, b"Traceback\nOSError: wrong checksum\n"
    assert probing.why_unreadable(crashed) == "OSError: wrong checksum"
    answer.stderr = b""
    assert probing.why_unreadable(crashed) == "HDF5 gave no reason"
    probing.read_all_but_frames(crashed)
    crashed.write_bytes(b"no file of HDF5")
    with pytest.raises(OSError, match="signature"):
        probing.read_all_but_frames(crashed)
