"""The dashboard answers only requests with its secret token and from its own address, and shows only its folder."""

from __future__ import annotations

import json
import os
import re
import signal
import socket
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any
from urllib.parse import unquote
from urllib.request import urlopen

import pytest
from websockets.exceptions import ConnectionClosed

from eimi_lab.page.redirect_file import redirect_file
from tests.patience import PATIENCE_S


def test_no_cookie_is_set_and_the_page_itself_holds_no_token(served: Any) -> None:
    # A browser sends a cookie to every port of the host, and therefore also to the server of another user.
    for path in ("/", f"/?token={'t' * 43}", "/static/main.js", "/api/folder"):
        answer = served.ask(path)
        assert answer.status == 200
        assert "set-cookie" not in answer.headers
        assert b"t" * 43 not in answer.body


@pytest.mark.parametrize(
    ("path", "headers"),
    [
        ("/api/folder", {"X_Eimi_Token": ""}),
        ("/api/folder", {"X_Eimi_Token": "guess"}),
        ("/api/folder", {"X_Eimi_Token": "", "Cookie": "token=" + "t" * 43}),
        ("/api/folder?token=" + "t" * 43, {"X_Eimi_Token": ""}),
        ("/api/dataset?file=run.h5", {"X_Eimi_Token": ""}),
        ("/report?file=run.h5", {"X_Eimi_Token": ""}),
        ("/api/folder", {"Sec_Fetch_Site": "cross-site"}),
        ("/api/folder", {"Sec_Fetch_Site": "same-site"}),
        ("/static/main.js", {"Sec_Fetch_Site": "cross-site"}),
    ],
)
def test_a_request_without_the_token_or_from_another_site_is_refused(served: Any, path: str, headers: dict) -> None:
    answer = served.ask(path, **headers)
    assert answer.status == 403
    assert b"run.h5" not in answer.body
    assert b"<html" not in answer.body


def test_a_websocket_receives_nothing_unless_its_first_message_is_the_token(served: Any) -> None:
    for message in ('{"token": "guess"}', '{"take": true}', '{"token": null}', "[1]", "[" * 30_000, b"\0"):
        with served.socket(introduced=False) as socket:
            with pytest.raises(TimeoutError):  # the server sends nothing to this socket
                socket.recv(timeout=0.05)
            socket.send(message)
            with pytest.raises(ConnectionClosed):
                socket.recv(timeout=PATIENCE_S)
            assert socket.close_code == 1008
    with served.socket() as socket:
        assert json.loads(socket.recv(timeout=PATIENCE_S))["kind"] == "state"


ANOTHER_USER = """
import os, sys, urllib.error, urllib.request
file, page = sys.argv[1:]

def status(method, path):
    asked = urllib.request.Request(page + path, b"{}" if method == "POST" else None, {"Origin": page}, method=method)
    try:
        return urllib.request.urlopen(asked).status
    except urllib.error.HTTPError as error:
        return error.code

status("POST", "/api/folder")  # imports what the other user may not be allowed to read
os.setgroups([])
os.setgid(65534)
os.setuid(65534)
try:
    print(open(file).read())
except PermissionError:
    print("not readable")
for method, path in (("GET", "/api/folder"), ("POST", "/api/stop"), ("POST", "/api/run/end")):
    print(status(method, path))
"""


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() != 0, reason="needs root, to become another user")
def test_another_user_of_the_computer_gets_neither_the_token_nor_an_answer(served: Any) -> None:
    with redirect_file(served.address) as path:
        assert "t" * 43 in path.read_text()
        assert path.stat().st_mode & 0o777 == 0o600
        path.parent.chmod(0o711)  # the mode of the file alone keeps other users out
        command = [sys.executable, "-c", ANOTHER_USER, str(path), f"http://{served.host}"]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.stdout.splitlines() == ["not readable", "403", "403", "403"], done.stderr
    assert not path.exists()


def test_the_browser_is_given_a_file_and_not_the_token(
    data_folder: Path, tab: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # All users can see command lines. Here, a command that writes down its own command line takes the place of the
    # browser.
    shown = tmp_path / "shown"
    shim = tmp_path / "browser"
    os.mkfifo(shown)
    shim.write_text(f'#!/bin/sh\necho "$@" > {shown}\n')
    shim.chmod(0o755)
    monkeypatch.setenv("BROWSER", str(shim))
    command = [sys.executable, "-m", "eimi_lab", "dashboard", "--browser", str(data_folder)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as process:
        try:
            assert process.stdout is not None
            token = process.stdout.readline().strip().rpartition("=")[2]
            given = shown.read_text().strip()  # waits for the browser
            assert given.startswith("file://")
            assert token not in given
            page = tab(given)
            page.get_by_text("in control", exact=True).first.wait_for()
            assert token not in page.url
        finally:
            process.terminate()


def test_a_server_on_another_port_learns_nothing_from_the_browser(served: Any, tab: Any) -> None:
    page = tab(served.address)
    page.get_by_text("in control", exact=True).first.wait_for()
    with socket.create_server(("127.0.0.1", 0)) as other:
        other.settimeout(PATIENCE_S)
        link = f"http://127.0.0.1:{other.getsockname()[1]}/"
        page.evaluate("link => { location.href = link; }", link)
        connection, _ = other.accept()
        with connection:
            received = connection.recv(65536)
            connection.sendall(b"HTTP/1.1 200 OK\r\nContent-Type: text/html\r\nContent-Length: 2\r\n\r\nhi")
        assert b"t" * 43 not in received
        assert b"cookie" not in received.lower()
        page.wait_for_url(link)
        assert page.evaluate("sessionStorage.getItem('token')") is None


def test_a_tab_without_the_token_shows_which_address_to_open(served: Any, tab: Any) -> None:
    page = tab(f"http://{served.host}/")
    page.get_by_text("open the address that `eimi dashboard` printed").wait_for()


@pytest.mark.parametrize(
    "host", ["evil.example", "evil.example:{port}", "127.0.0.1:1", "127.0.0.1.evil.example:{port}"]
)
def test_a_request_to_this_machine_under_another_host_name_is_refused(served: Any, host: str) -> None:
    assert served.ask("/api/folder", Host=host.format(port=served.port)).status == 421


@pytest.mark.parametrize("origin", ["", "null", "http://evil.example", "http://127.0.0.1:1", "https://{host}"])
def test_a_post_of_another_origin_is_refused(served: Any, origin: str) -> None:
    answer = served.ask("/api/folder", "POST", b"{}", Origin=origin.format(host=served.host))
    assert answer.status == 403


@pytest.mark.parametrize(("length", "status"), [(1 << 15, 400), ((1 << 16) + 1, 413), (1 << 30, 413)])
def test_a_request_that_is_too_long_is_not_read(served: Any, length: int, status: int) -> None:
    origin = f"http://{served.host}"
    body = b"x" * min(length, 1 << 15)
    answer = served.ask("/api/pictures/edges", "POST", body, Origin=origin, Content_Length=str(length))
    assert answer.status == status


def test_a_request_without_a_length_in_its_header_is_not_read(served: Any) -> None:
    assert served.ask("/api/folder").status == 200
    assert served.ask("/api/folder", Transfer_Encoding="chunked").status == 413


def test_the_headers_forbid_the_browser_to_run_anything_but_the_page(served: Any) -> None:
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
    assert sum(len(served.ask(f"/static/{file.name}").body) for file in static.iterdir()) < 100_000


@pytest.mark.parametrize("name", ["../secret.h5", "/etc/passwd", "frames/../../secret.h5", "link/secret.h5", "a%00b"])
def test_no_path_leads_out_of_the_folder(served: Any, name: str) -> None:
    secret = served.folder.parent / "outside"
    secret.mkdir(exist_ok=True)
    (secret / "secret.h5").write_text("secret")
    if not (served.folder / "link").is_symlink():
        (served.folder / "link").symlink_to(secret)
    report = f"/report?file={name}&key={served.page.reports._key(unquote(name))}"
    for path in (f"/api/dataset?file={name}", f"/api/folder?in={name}", report):
        answer = served.ask(path)
        assert answer.status == 400
        assert "leads out of the folder" in json.loads(answer.body)["error"]
    listed = json.loads(served.ask("/api/folder").body)["entries"]
    assert {"run.h5", "frames"} <= {entry["name"] for entry in listed}
    assert "link" not in {entry["name"] for entry in listed}


def test_only_the_static_files_of_the_page_are_served(served: Any) -> None:
    for path in ("/static/../server.py", "/static/%2e%2e/server.py", "/static//etc/passwd"):
        assert served.ask(path).status == 404


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--host", "192.0.2.1"], "--open-to-network"),
        (["--host", "0.0.0.0", "--open-to-network"], "stands for all addresses of this computer"),
        (["--host", "192.0.2.1", "--open-to-network"], "the program cannot listen there"),
        (["nowhere"], "is not a folder"),
    ],
)
def test_an_address_that_other_machines_reach_needs_an_option(
    run: Callable[..., tuple[int, str]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: list, words: str
) -> None:
    monkeypatch.chdir(tmp_path)
    status, message = run("dashboard", *arguments)
    assert status == 2
    assert words in message


@pytest.mark.parametrize("signals", [[signal.SIGTERM], [signal.SIGHUP], [signal.SIGINT, signal.SIGINT, signal.SIGINT]])
def test_the_command_prints_the_address_and_ends_at_a_signal(data_folder: Path, signals: list[signal.Signals]) -> None:
    command = [sys.executable, "-m", "eimi_lab", "dashboard", str(data_folder)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        address = process.stdout.readline().strip()
        try:
            page = urlopen(address, timeout=PATIENCE_S).read()
        finally:
            for number in signals:
                process.send_signal(number)
            message = process.communicate(timeout=PATIENCE_S)[1]
    assert b"<title>eimi" in page
    # A second signal may arrive while the interpreter ends and the default handlers of the system are active again.
    assert process.returncode in (128 + signals[0], -signals[0])
    assert [line.partition(":")[0] for line in message.splitlines()] == ["eimi", "eimi"]
    assert message.splitlines()[-1] == f"eimi: stopped by {signals[0].name}"
    assert address.rpartition("=")[2] not in message
