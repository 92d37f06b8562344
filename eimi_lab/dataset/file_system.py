"""Whether a folder lies on a network: such file systems do not keep the order of writes, as a crash would show."""

from __future__ import annotations

from pathlib import Path

NETWORK = frozenset(
    {"nfs", "nfs4", "cifs", "smb3", "smbfs", "ncpfs", "afs", "9p", "ceph", "lustre", "gpfs", "beegfs", "glusterfs"}
    | {"fuse.sshfs", "fuse.glusterfs", "fuse.cephfs", "fuse.rclone", "fuse.davfs", "davfs"}
)
MOUNTS = Path("/proc/self/mounts")


def network_file_system(folder: Path, mounts: Path = MOUNTS) -> str | None:
    """The kind of network file system that a folder lies on; None for a local one, and where no table of mounts is.

    The table is Linux's (proc(5)): device, place and kind of each mount, a space in a place written as \\040.
    """
    if not mounts.is_file():
        return None
    kind, depth = "", -1
    for line in mounts.read_text().splitlines():
        place, found = line.split()[1:3]
        at = Path(place.replace("\\040", " "))
        if folder.resolve().is_relative_to(at) and len(at.parts) >= depth:  # of two at one place the later one counts
            kind, depth = found, len(at.parts)
    return kind if kind in NETWORK else None
