"""Result files are written whole or not at all, errors name the user's file, and locks are held and released."""

from __future__ import annotations

import errno
import os
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import pytest

from eimi_lab.process import outputs, paths, replacing, synchronising, writer_lock
from eimi_lab.process.errors import InputError
from eimi_lab.process.outputs import (
    check_distinct,
    new_folder,
    refuse_existing,
    whole_file,
    whole_folder,
    write_file,
    write_whole,
)
from eimi_lab.process.writer_lock import WriterLock, is_being_written, lock_file, only_writer

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="needs links, pipes and the errors of POSIX")


def names(folder: Path) -> list[str]:
    return sorted(entry.name for entry in folder.iterdir())


def full(*_: object, **__: object) -> None:
    raise OSError(errno.ENOSPC, "No space left on device")


# Which path may become a file


def test_a_new_file_needs_a_free_name_in_a_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "old.h5").write_bytes(b"old")
    (tmp_path / "folder").mkdir()
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "link.h5").symlink_to(tmp_path / "nowhere" / "run.h5")
    refuse_existing(tmp_path / "new.h5", force=False)
    refuse_existing(tmp_path / "old.h5", force=True)
    for name, force, words in (
        ("old.h5", False, "exists already; give another name, or --force to replace it"),
        ("folder", True, "is a folder; give the name of a file"),
        ("pipe", True, "is a device or a pipe"),
        ("missing/new.h5", True, f"there is no folder {tmp_path / 'missing'}$"),
        ("link.h5", True, f"there is no folder {tmp_path / 'nowhere'}$"),
    ):
        with pytest.raises(InputError, match=f"^{tmp_path / name}: {words}"):
            refuse_existing(tmp_path / name, force)
    asked: list[object] = []
    monkeypatch.setattr(os, "access", lambda *given: asked.append(given))
    with pytest.raises(InputError, match=r"the folder .* cannot be written to"):
        refuse_existing(tmp_path / "new.h5", force=False)
    assert asked == [(tmp_path, os.W_OK)]


def test_a_file_is_read_or_written_once_in_a_command(tmp_path: Path) -> None:
    first, second, link = tmp_path / "a.h5", tmp_path / "b.h5", tmp_path / "c.h5"
    link.symlink_to(first)
    check_distinct([first, second], [tmp_path / "d.h5", tmp_path / "e.h5"])
    for read, written, words in (
        ([first, second, link], [], f"{link}: is given twice"),
        ([first], [second, link], f"{link}: cannot be written, because the same command already reads or writes"),
        ([], [second, first, link], f"{link}: cannot be written"),
    ):
        with pytest.raises(InputError, match=words):
            check_distinct(read, written)


def test_the_links_of_a_path_are_followed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "real").mkdir()
    (tmp_path / "link").symlink_to("real")
    (tmp_path / "loop").symlink_to("loop")
    assert paths.followed(tmp_path / "link" / "run.h5") == (tmp_path / "real" / "run.h5").resolve()
    assert paths.reachable(tmp_path / "x") == tmp_path / "x"
    assert paths.named_in(tmp_path / "a.toml", "shape.csv") == tmp_path / "shape.csv"

    def failing(number: int | None, path: Path) -> Path:
        error = OSError(errno.EIO, "no answer")
        error.winerror = number  # type: ignore[attr-defined]
        raise error

    for number in (206, 234):  # ERROR_FILENAME_EXCED_RANGE and ERROR_MORE_DATA (winerror.h)
        monkeypatch.setattr(Path, "resolve", lambda path, number=number: failing(number, path))
        assert paths.followed(tmp_path / "link" / ".." / "run.h5") == tmp_path / "run.h5"
    for number in (None, 5):
        monkeypatch.setattr(Path, "resolve", lambda path, number=number: failing(number, path))
        with pytest.raises(InputError, match=r"run\.h5: is a symbolic link that cannot be followed \(.*no answer"):
            paths.followed(tmp_path / "run.h5")


# Whole files


def test_a_whole_file_appears_at_the_end_and_leaves_nothing_else(tmp_path: Path) -> None:
    path = tmp_path / "fits.json"
    with whole_file(path, force=False) as temporary:
        temporary.write_text("new")
        assert temporary.parent == tmp_path
        assert temporary.name.startswith(".fits.json.")
        assert is_being_written(path)
        assert not path.exists()
    assert path.read_text() == "new"
    assert names(tmp_path) == ["fits.json"]
    write_file(path, "µ", force=True)
    assert path.read_bytes() == b"\xc2\xb5"
    write_file(path, b"\xff", force=True)
    assert path.read_bytes() == b"\xff"
    with pytest.raises(InputError, match="exists already"):
        write_file(path, "x", force=False)
    assert path.read_bytes() == b"\xff"


def test_another_writer_may_create_the_file_while_the_lock_is_waited_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "fits.json"

    class Late(WriterLock):
        def __init__(self, file: Path) -> None:
            super().__init__(file)
            file.write_text("of another writer")

    monkeypatch.setattr(writer_lock, "WriterLock", Late)
    with pytest.raises(InputError, match="exists already"):
        write_file(path, "mine", force=False)
    assert path.read_text() == "of another writer"
    assert names(tmp_path) == ["fits.json"]


def test_a_file_that_exists_is_refused_before_its_lock_is_asked_for(tmp_path: Path) -> None:
    path = tmp_path / "fits.json"
    path.touch()
    other = os.open(lock_file(path), os.O_RDWR | os.O_CREAT)
    writer_lock.lock_descriptor(other, blocking=False)
    with pytest.raises(InputError, match="exists already"):
        write_file(path, "x", force=False)
    with pytest.raises(InputError, match="is being written to by"):
        write_file(path, "x", force=True)
    os.close(other)


def raising(error: BaseException, path: Path) -> None:
    with whole_file(path, force=True) as temporary:
        temporary.write_text("half")
        raise error


def test_an_error_leaves_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "fits.json"
    path.write_text("old")
    for error in (KeyboardInterrupt(), ValueError(), OSError("without a number")):
        with pytest.raises(type(error)) as caught:
            raising(error, path)
        assert caught.value is error
    assert path.read_text() == "old"
    assert names(tmp_path) == ["fits.json"]


def test_an_error_of_the_disk_names_the_file_of_the_user(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "fits.json"
    other = OSError(errno.ENOENT, "No such file", str(tmp_path / "frames"))
    with pytest.raises(OSError, match="frames") as caught:
        raising(other, path)
    assert caught.value is other
    with pytest.raises(FileNotFoundError) as gone, whole_file(path, force=True):
        pass  # nothing is written, so that the temporary file cannot be opened
    assert gone.value.filename == str(path)
    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space left") as caught:
        write_file(path, "x", force=True)
    assert (caught.value.errno, caught.value.filename) == (errno.ENOSPC, str(path))
    (tmp_path / "link.json").symlink_to(path)
    with pytest.raises(OSError, match="No space left") as caught:
        write_file(tmp_path / "link.json", "x", force=True)
    assert caught.value.filename == str(tmp_path / "link.json")
    with pytest.raises(OSError, match="No space left") as caught:
        write_whole(path, b"x")
    assert (caught.value.errno, caught.value.filename) == (errno.ENOSPC, str(path))
    monkeypatch.undo()

    def refused(source: object, target: object) -> None:
        raise OSError(errno.EXDEV, "Another disk", str(tmp_path / "x"), None, str(source))

    monkeypatch.setattr(os, "replace", refused)
    with pytest.raises(OSError, match="Another disk") as caught:
        write_file(path, "x", force=True)
    assert caught.value.filename == str(path)
    assert caught.value.filename2 is None


def test_the_content_of_a_file_is_synchronised(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    sizes: list[int] = []
    monkeypatch.setattr(os, "fsync", lambda descriptor: sizes.append(os.fstat(descriptor).st_size))
    write_whole(tmp_path / "a", b"five!")
    write_file(tmp_path / "b", "seven 7", force=False)
    assert sizes == [5, 7]
    assert (tmp_path / "a").read_bytes() == b"five!"


# Whole folders


def test_a_folder_gets_all_files_at_the_end(tmp_path: Path) -> None:
    folder = tmp_path / "new" / "results"
    with whole_folder(folder, force=False) as unfinished:
        assert unfinished.parent == folder
        assert unfinished.name.startswith(".unfinished.")
        write_whole(unfinished / "a.txt", b"a")
        write_whole(unfinished / "b.txt", b"b")
        assert names(folder) == [unfinished.name]
    assert names(folder) == ["a.txt", "b.txt"]
    with pytest.raises(InputError, match="is not empty; give another folder, or --force"), whole_folder(folder, False):
        pass
    with whole_folder(folder, force=True) as unfinished:
        write_whole(unfinished / "b.txt", b"new")
    assert [path.read_bytes() for path in sorted(folder.iterdir())] == [b"a", b"new"]
    hidden = tmp_path / "hidden"
    hidden.mkdir()
    (hidden / ".kept").touch()
    with whole_folder(hidden, force=False) as unfinished:
        write_whole(unfinished / "c.txt", b"c")
    assert names(hidden) == [".kept", "c.txt"]


def failing_folder(folder: Path, error: Callable[[Path], BaseException]) -> None:
    with whole_folder(folder, force=True) as unfinished:
        write_whole(unfinished / "a.txt", b"a")
        raise error(unfinished)


def test_after_an_error_the_folder_is_as_before(tmp_path: Path) -> None:
    existing = tmp_path / "existing"
    existing.mkdir()
    for folder in (existing, tmp_path / "new" / "results"):
        with pytest.raises(KeyboardInterrupt):
            failing_folder(folder, lambda _: KeyboardInterrupt())
    assert names(tmp_path) == ["existing"]
    assert names(existing) == []


def test_a_folder_that_was_filled_meanwhile_stays(tmp_path: Path) -> None:
    folder = tmp_path / "new" / "results"

    def filled(unfinished: Path) -> BaseException:
        (folder / "of another program").touch()
        return KeyboardInterrupt()

    with pytest.raises(KeyboardInterrupt):
        failing_folder(folder, filled)
    assert names(folder) == ["of another program"]


@pytest.mark.parametrize(
    ("number", "file", "named"),
    [
        (errno.ENOSPC, "unfinished/a.txt", "results/a.txt"),
        (errno.ENOSPC, "elsewhere/a.txt", "elsewhere/a.txt"),
        (errno.ENOSPC, None, None),
    ],
)
def test_an_error_names_the_file_in_the_final_folder(
    tmp_path: Path, number: int, file: str | None, named: str | None
) -> None:
    folder = tmp_path / "results"
    folder.mkdir()

    def error(unfinished: Path) -> OSError:
        place = file and str(tmp_path / file).replace(str(tmp_path / "unfinished"), str(unfinished))
        return OSError(number, "No space left", *([place] if place else []))

    with pytest.raises(OSError, match="No space left") as caught:
        failing_folder(folder, error)
    assert caught.value.filename == (named and str(tmp_path / named))
    assert caught.value.errno == errno.ENOSPC


def test_a_folder_that_cannot_be_created_or_used_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match=r"file/results: the folder cannot be created \(Not a directory\)"):
        new_folder(tmp_path / "file" / "results", force=False)
    monkeypatch.setattr(outputs.tempfile, "TemporaryDirectory", full)
    with (
        pytest.raises(InputError, match=r"no file can be created in this folder \(No space left"),
        whole_folder(tmp_path / "results", force=False),
    ):
        pass
    assert names(tmp_path) == ["file"]


def test_a_linked_file_of_a_folder_is_written_through_its_link(tmp_path: Path) -> None:
    folder = tmp_path / "results"
    folder.mkdir()
    (tmp_path / "shared.txt").write_text("old")
    (folder / "a.txt").symlink_to(tmp_path / "shared.txt")
    with whole_folder(folder, force=True) as unfinished:
        write_whole(unfinished / "a.txt", b"new")
    assert (folder / "a.txt").is_symlink()
    assert (tmp_path / "shared.txt").read_text() == "new"


# Replacing and removing


def denied(number: int | None = None) -> PermissionError:
    error = PermissionError(errno.EACCES if number != 112 else errno.ENOSPC, "Permission denied")
    error.winerror = number  # type: ignore[attr-defined]
    return error


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> dict[str, float]:
    now = {"s": 100.0, "slept": 0}
    monkeypatch.setattr(
        replacing,
        "time",
        SimpleNamespace(monotonic=lambda: now["s"], sleep=lambda s: now.update(s=now["s"] + s, slept=now["slept"] + 1)),
    )
    return now


def test_a_file_in_use_is_tried_for_5_s(monkeypatch: pytest.MonkeyPatch, clock: dict[str, float]) -> None:
    monkeypatch.setattr(replacing.sys, "platform", "win32")

    def in_use() -> None:
        raise denied()

    with pytest.raises(PermissionError):
        replacing.patiently(in_use)
    assert clock["s"] == pytest.approx(105.0, abs=0.06)
    assert 50 <= clock["slept"] <= 101


@pytest.mark.parametrize(("number", "words"), [(32, "another program has the file open"), (112, "^.Errno")])
def test_a_file_that_stays_in_use_is_named_or_left(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, clock: dict[str, float], number: int, words: str
) -> None:
    def in_use(*_: object, **__: object) -> None:
        raise denied(number)

    (tmp_path / "a").write_text("new")
    replacing.replace(tmp_path / "a", tmp_path / "b")
    assert (tmp_path / "b").read_text() == "new"
    replacing.remove(tmp_path / "a")
    monkeypatch.setattr(replacing.sys, "platform", "win32")
    monkeypatch.setattr(os, "replace", in_use)
    monkeypatch.setattr(Path, "unlink", in_use)
    with pytest.raises(PermissionError, match=words):
        replacing.replace(tmp_path / "b", tmp_path / "c")
    if number == 32:
        replacing.remove(tmp_path / "b")
    else:
        with pytest.raises(PermissionError):
            replacing.remove(tmp_path / "b")


def test_a_denied_removal_is_an_error_elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(*_: object, **__: object) -> None:
        raise denied()

    monkeypatch.setattr(replacing.sys, "platform", "linux")
    monkeypatch.setattr(Path, "unlink", refused)
    with pytest.raises(PermissionError):
        replacing.remove(tmp_path / "b")


def test_the_error_of_the_disk_is_raised_after_the_wait(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(descriptor: int) -> None:
        raise OSError(errno.EIO, "Input/output error")

    monkeypatch.setattr(synchronising.os, "fsync", fail)
    with pytest.raises(OSError, match="Input/output"):
        synchronising.synchronise(0, lambda: None)


# Locks


@pytest.fixture
def open_locks(monkeypatch: pytest.MonkeyPatch) -> Callable[[], int]:
    # A function that returns how many lock files of this test are still open.
    opened: list[tuple[int, os.stat_result]] = []
    open_file = os.open

    def opening(path: Path, *flags: int) -> int:
        descriptor = open_file(path, *flags)
        if str(path).endswith(".lock"):
            opened.append((descriptor, os.fstat(descriptor)))
        return descriptor

    def is_open(descriptor: int, file: os.stat_result) -> bool:
        try:
            return os.path.samestat(os.fstat(descriptor), file)
        except OSError:
            return False

    monkeypatch.setattr(os, "open", opening)
    return lambda: len({descriptor for descriptor, file in opened if is_open(descriptor, file)})


def test_a_lock_is_released_as_often_as_it_was_taken(tmp_path: Path) -> None:
    path = tmp_path / "run.h5"
    first = WriterLock(path)
    second = WriterLock(path)
    assert lock_file(path) == tmp_path / ".run.h5.lock"
    assert lock_file(path).read_text().startswith(f" process {os.getpid()} on ")
    second.release()
    assert is_being_written(path)
    first.release()
    assert not is_being_written(path)
    assert names(tmp_path) == []
    first.release()  # once more does nothing
    with only_writer(path):
        assert is_being_written(path)
    assert not is_being_written(path)


def in_thread(act: Callable[[], object]) -> list[object]:
    # Return what `act` returns or raises in another thread.
    result: list[object] = []

    def run() -> None:
        try:
            result.append(act())
        except InputError as error:
            result.append(error)

    thread = threading.Thread(target=run)
    thread.start()
    thread.join()
    return result


def test_another_thread_is_told_who_holds_the_lock(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "run.h5"
    monkeypatch.setattr(sys, "argv", ["/usr/bin/eimi", "acquire", "protocol.toml"])
    lock = WriterLock(path)
    (error,) = in_thread(lambda: WriterLock(path))
    assert f"{path}: is being written to by process {os.getpid()} on " in str(error)
    assert "(eimi acquire); wait until it has ended, or give another name" in str(error)
    lock_file(path).write_bytes(b"")
    (error,) = in_thread(lambda: WriterLock(path))
    assert "is being written to by another program;" in str(error)
    lock.release()
    (taken,) = in_thread(lambda: WriterLock(path))
    assert isinstance(taken, WriterLock)
    taken.release()


def test_the_holder_is_named_without_the_byte_that_is_locked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # Windows does not let other processes read the locked byte.
    monkeypatch.setattr(writer_lock, "_LOCKED_BYTE", "x")
    lock = WriterLock(tmp_path / "run.h5")
    assert writer_lock._holder(lock_file(tmp_path / "run.h5")).startswith(f"process {os.getpid()} on ")
    lock.release()


def test_a_lock_of_another_open_file_is_seen_and_refused(tmp_path: Path, open_locks: Callable[[], int]) -> None:
    # flock(2) belongs to an open file; a second open file takes the place of another program.
    path = tmp_path / "run.h5"
    other = os.open(lock_file(path), os.O_RDWR | os.O_CREAT)
    os.write(other, b" process 7 on lab\n (eimi  acquire)")
    assert not is_being_written(path)
    assert writer_lock.lock_descriptor(other, blocking=False)
    assert is_being_written(path)
    with pytest.raises(InputError, match=r"by process 7 on lab \(eimi acquire\); wait"):
        WriterLock(path)
    assert open_locks() == 1
    os.close(other)
    lock = WriterLock(path)
    assert lock_file(path).read_text().startswith(f" process {os.getpid()} on ")
    assert "process 7 " not in lock_file(path).read_text()
    lock.release()
    assert open_locks() == 0


def test_a_lock_file_with_a_second_name_is_not_written_to(tmp_path: Path) -> None:
    path = tmp_path / "run.h5"
    (tmp_path / "letter").write_text("of another user")
    os.link(tmp_path / "letter", lock_file(path))
    with only_writer(path):
        assert (tmp_path / "letter").read_text() == "of another user"


def test_a_lock_file_that_was_removed_meanwhile_is_taken_anew(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, open_locks: Callable[[], int]
) -> None:
    path = tmp_path / "run.h5"
    taken: list[int] = []
    take = writer_lock.lock_descriptor

    def after_the_release_of_another(descriptor: int, blocking: bool) -> bool:
        taken.append(descriptor)
        if len(taken) == 1:
            lock_file(path).unlink()
        if len(taken) == 2:  # another program has created a new lock file
            lock_file(path).unlink()
            lock_file(path).touch()
        return bool(take(descriptor, blocking=blocking))

    monkeypatch.setattr(writer_lock, "lock_descriptor", after_the_release_of_another)
    lock = WriterLock(path)
    assert len(taken) == 3
    assert lock_file(path).read_text().startswith(" process ")
    lock.release()
    assert open_locks() == 0


def test_a_file_system_without_locks_gets_a_warning(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    open_locks: Callable[[], int],
) -> None:
    def unsupported(descriptor: int, blocking: bool) -> bool:
        lock_file(tmp_path / "run.h5").unlink(missing_ok=True)  # another program removes it
        raise OSError(errno.ENOLCK, "No locks available")

    path = tmp_path / "run.h5"
    monkeypatch.setattr(writer_lock, "lock_descriptor", unsupported)
    lock = WriterLock(path)
    assert "run.h5: cannot be locked (No locks available); no other program should write" in capsys.readouterr().err
    assert names(tmp_path) == []
    lock.release()
    lock_file(path).touch()
    assert not is_being_written(path)
    assert open_locks() == 0


def test_a_forked_process_does_not_release_the_lock_of_its_parent(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "run.h5"
    lock = WriterLock(path)
    with monkeypatch.context() as forked:
        forked.setattr(os, "getpid", lambda: -5)
        lock.release()
        assert is_being_written(path)
        with pytest.raises(InputError, match="is being written to by process"):
            WriterLock(path)
    lock.release()
    assert not is_being_written(path)


def test_a_lock_in_a_missing_or_closed_folder_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(InputError, match=f"x/run.h5: there is no folder {tmp_path / 'x'}$"):
        WriterLock(tmp_path / "x" / "run.h5")
    monkeypatch.setattr(os, "open", full)
    with pytest.raises(InputError, match=r"no file can be created in the folder .* \(No space left on device\)$"):
        WriterLock(tmp_path / "run.h5")


def test_on_a_full_disk_the_lock_holds_without_a_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as disk:
        disk.setattr(os, "write", full)
        lock = WriterLock(tmp_path / "run.h5")
    assert is_being_written(tmp_path / "run.h5")
    lock.release()
    assert names(tmp_path) == []
