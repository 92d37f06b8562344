"""Who is let in, and what the page lets be seen of the machine."""

from __future__ import annotations

import json
import re
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any
from urllib.request import HTTPCookieProcessor, build_opener

import pytest

from tests.patience import PATIENCE_S


def test_the_token_becomes_a_cookie_that_scripts_cannot_read(served: Any) -> None:
    answer = served.ask(f"/?token={'t' * 43}", Cookie="")
    assert answer.status == 303
    assert answer.headers["location"] == "/"
    cookie = answer.headers["set-cookie"].lower()
    assert "httponly" in cookie
    assert "samesite=strict" in cookie
    assert served.ask("/").status == 200


@pytest.mark.parametrize(
    ("path", "headers"),
    [
        ("/", {"Cookie": ""}),
        ("/api/folder", {"Cookie": ""}),
        ("/static/main.js", {"Cookie": ""}),
        ("/?token=guess", {"Cookie": ""}),
        ("/?token=", {"Cookie": ""}),
        ("/api/folder", {"Cookie": "eimi_1=x; nonsense"}),
        ("/api/folder?token=" + "t" * 43, {"Cookie": ""}),
        ("/api/folder", {"Sec_Fetch_Site": "cross-site"}),
        ("/api/folder", {"Sec_Fetch_Site": "same-site"}),
    ],
)
def test_who_has_no_token_or_comes_from_another_site_gets_nothing(served: Any, path: str, headers: dict) -> None:
    answer = served.ask(path, **headers)
    assert answer.status == 403
    assert b"run.h5" not in answer.body
    assert b"<html" not in answer.body


@pytest.mark.parametrize(
    "host", ["evil.example", "evil.example:{port}", "127.0.0.1:1", "127.0.0.1.evil.example:{port}"]
)
def test_a_foreign_name_for_this_machine_is_refused(served: Any, host: str) -> None:
    assert served.ask("/api/folder", Host=host.format(port=served.port)).status == 421


@pytest.mark.parametrize("origin", ["", "null", "http://evil.example", "http://127.0.0.1:1", "https://{host}"])
def test_a_post_of_another_origin_is_refused(served: Any, origin: str) -> None:
    answer = served.ask("/api/folder", "POST", b"{}", Origin=origin.format(host=served.host))
    assert answer.status == 403


@pytest.mark.parametrize(("length", "status"), [(1 << 15, 400), ((1 << 16) + 1, 413), (1 << 30, 413)])
def test_what_is_too_long_is_not_read(served: Any, length: int, status: int) -> None:
    """As its header says; 400 is of a body that is read, and is no request."""
    origin = f"http://{served.host}"
    body = b"x" * min(length, 1 << 15)
    answer = served.ask("/api/pictures/edges", "POST", body, Origin=origin, Content_Length=str(length))
    assert answer.status == status


def test_a_body_of_a_length_that_is_not_told_is_not_read(served: Any) -> None:
    assert served.ask("/api/folder").status == 200
    assert served.ask("/api/folder", Transfer_Encoding="chunked").status == 413


def test_a_browser_is_told_to_run_nothing_but_the_page(served: Any) -> None:
    headers = served.ask("/").headers
    policy = headers["content-security-policy"]
    assert "default-src 'none'" in policy
    assert "unsafe" not in policy
    assert "frame-ancestors 'none'" in policy
    assert headers["x-content-type-options"] == "nosniff"
    assert headers["cross-origin-resource-policy"] == "same-origin"
    page = served.ask("/").body.decode()
    assert not re.search(r"\son\w+=|\sstyle=|<style|<script(?![^>]*\ssrc=)", page)
    assert not re.search(r"(src|href)=.https?:", page)


def test_the_first_load_is_small(served: Any) -> None:
    static = Path(sys.modules["eimi_lab.page"].__path__[0]) / "static"
    assert sum(len(served.ask(f"/static/{file.name}").body) for file in static.iterdir()) < 60_000


@pytest.mark.parametrize("name", ["../secret.h5", "/etc/passwd", "frames/../../secret.h5", "link/secret.h5", "a%00b"])
def test_no_path_leads_out_of_the_folder(served: Any, name: str) -> None:
    secret = served.folder.parent / "outside"
    secret.mkdir(exist_ok=True)
    (secret / "secret.h5").write_text("secret")
    if not (served.folder / "link").is_symlink():
        (served.folder / "link").symlink_to(secret)
    for path in (f"/api/dataset?file={name}", f"/api/folder?in={name}", f"/report?file={name}"):
        answer = served.ask(path)
        assert answer.status == 400
        assert "leads out of the folder" in json.loads(answer.body)["error"]
    listed = json.loads(served.ask("/api/folder").body)["entries"]
    assert {"run.h5", "frames"} <= {entry["name"] for entry in listed}
    assert "link" not in {entry["name"] for entry in listed}


def test_static_files_are_the_pages_own(served: Any) -> None:
    for path in ("/static/../server.py", "/static/%2e%2e/server.py", "/static//etc/passwd"):
        assert served.ask(path).status == 404


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--host", "192.0.2.1"], "--open-to-network"),
        (["--host", "0.0.0.0", "--open-to-network"], "one address of this machine"),
        (["--host", "192.0.2.1", "--open-to-network"], "cannot be listened on"),
        (["nowhere"], "is no folder"),
    ],
)
def test_other_addresses_want_to_be_asked_for(
    run: Callable[..., tuple[int, str]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: list, words: str
) -> None:
    monkeypatch.chdir(tmp_path)
    status, said = run("dashboard", *arguments)
    assert status == 2
    assert words in said


@pytest.mark.parametrize("asked", [[signal.SIGTERM], [signal.SIGHUP], [signal.SIGINT, signal.SIGINT, signal.SIGINT]])
def test_the_command_prints_the_address_and_ends_by_a_signal(data_folder: Path, asked: list[signal.Signals]) -> None:
    command = [sys.executable, "-m", "eimi_lab", "dashboard", str(data_folder)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        address = process.stdout.readline().strip()
        try:
            page = build_opener(HTTPCookieProcessor()).open(address, timeout=PATIENCE_S).read()
        finally:
            for number in asked:
                process.send_signal(number)
            said = process.communicate(timeout=PATIENCE_S)[1]
    assert b"<title>eimi" in page
    # A further signal may find the interpreter leaving already, with the system's own handlers back in place.
    assert process.returncode in (128 + asked[0], -asked[0])
    assert [line.partition(":")[0] for line in said.splitlines()] == ["eimi", "eimi"]
    assert said.splitlines()[-1] == f"eimi: stopped by {asked[0].name}"
    assert address.rpartition("=")[2] not in said
