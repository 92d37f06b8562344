"""A damaged file of a tracking program is refused in one line; a row without a time is left out."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from eimi_lab.dataset.tracked.deeplabcut import read_deeplabcut
from eimi_lab.dataset.tracked.dice import read_dice
from eimi_lab.dataset.tracked.dltdv import read_dltdv
from eimi_lab.dataset.tracked.tracker import read_tracker
from eimi_lab.dataset.tracked.tracks import Tracks
from eimi_lab.process.errors import InputError

OF_DICE = "COORDINATE_X,COORDINATE_Y,DISPLACEMENT_X,DISPLACEMENT_Y\n"
OF_DEEPLABCUT = "bodyparts,{parts}\ncoords,{coords}\n{frame},1,2\n"


@pytest.mark.parametrize(
    ("read", "text", "words"),
    [
        (
            read_dice,
            f"SUBSET_ID,{OF_DICE}0,1,2,0,0\nnan,1,2,0,0\n",
            "line 3 should have a number in the column SUBSET_ID",
        ),
        (read_dice, f"FRAME,{OF_DICE}1e999,1,2,0,0\n", "line 2 should have a number in the column FRAME"),
        (
            read_deeplabcut,
            OF_DEEPLABCUT.format(parts="tip", coords="x,y", frame=0),
            "the rows bodyparts and coords should have equal numbers of cells, not 1 and 2",
        ),
        (
            read_deeplabcut,
            "individuals,beam\n" + OF_DEEPLABCUT.format(parts="tip,tip", coords="x,y", frame=0),
            "the rows individuals and coords should have equal numbers of cells, not 1 and 2",
        ),
        (
            read_deeplabcut,
            OF_DEEPLABCUT.format(parts="tip,tip", coords="X,Y", frame=0),
            "the row coords should contain x and y for a part of bodyparts",
        ),
        (
            read_deeplabcut,
            OF_DEEPLABCUT.format(parts="tip,tip", coords="x,y", frame="²"),
            "line 3 should have the number of a frame",
        ),
        (read_dltdv, "DLTdv data file\n3\t0\t0\n", "its columns should be named pt1_cam1_X"),
        (read_tracker, "t,x,y\n,1,2\n", "at least one row should have a number in the column t"),
    ],
)
def test_a_damaged_file_is_refused_in_one_line(
    tmp_path: Path, read: Callable[[Path], Tracks], text: str, words: str
) -> None:
    path = tmp_path / "tracks.txt"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError) as caught:
        read(path)
    message = str(caught.value)
    assert message.startswith(f"{path}: is not a file of ")
    assert words in message
    assert "\n" not in message


@pytest.mark.parametrize(("column", "frames"), [("t", [0, 2]), ("frame", [5, 7])])
def test_a_row_of_tracker_without_a_time_or_frame_is_left_out(tmp_path: Path, column: str, frames: list[int]) -> None:
    # Times count the rows of the file, also those that are left out.
    path = tmp_path / "tracks.txt"
    path.write_text(f"{column},x,y\n5,1,2\n,3,4\n7,5,6\n")
    tracks = read_tracker(path)
    assert tracks.frames.tolist() == frames
    assert tracks.places.tolist() == [[[1.0, 2.0]], [[5.0, 6.0]]]
    assert (None if tracks.times_s is None else tracks.times_s.tolist()) == ([5.0, 7.0] if column == "t" else None)
