"""The server as programs meet it: plain requests, sockets, processes."""

import http.client
import json
import os
import signal
import struct
import subprocess
import sys
from contextlib import contextmanager

import pytest
from PIL import Image
from served import serving, wait_for

websockets = pytest.importorskip("websockets.sync.client", reason="the extra `view` is missing")
from websockets.exceptions import ConnectionClosed, InvalidStatus  # noqa: E402 -- see above

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="processes are told otherwise")

WANT = {"type": "want", "size": [64, 48], "samples": 1}


@pytest.fixture(scope="module")
def served(tmp_path_factory):
    file = tmp_path_factory.mktemp("served") / "ball.pcsg"
    file.write_text("{n = 2} uscale(n) sphere\n")
    with serving(file) as running:
        yield running


def ask(served, path="/", **headers):
    connection = http.client.HTTPConnection("127.0.0.1", served.port, timeout=30)
    connection.putrequest("GET", path, skip_host="Host" in headers)
    for name, value in headers.items():
        connection.putheader(name, value)
    connection.endheaders()
    answer = connection.getresponse()
    return answer.status, answer.read(), answer.headers


@contextmanager
def connect(served, token=None, window="w", origin=None):
    address = f"ws://localhost:{served.port}/ws"
    with websockets.connect(address, origin=origin or served.address, max_size=None) as socket:
        told = served.token if token is None else token
        socket.send(json.dumps({"token": told, "window": window}))
        yield socket


def hear(socket, kind):
    """Return the next message of a kind."""
    while True:
        message = socket.recv(timeout=120)
        if isinstance(message, bytes):
            size, measured = struct.unpack("<II", message[:8])
            found = json.loads(message[8 : 8 + size])
            found["data"] = message[8 + size + measured :]
        else:
            found = json.loads(message)
        if found["type"] == kind:
            return found


def test_the_page_holds_no_secret_and_loads_nothing_from_elsewhere(served):
    for path in ("/", "/main.js", "/link.js", "/style.css"):
        status, body, headers = ask(served, path)
        assert status == 200
        assert served.token.encode() not in body
        assert b"https://" not in body and b"//cdn" not in body
        assert "default-src 'none'" in headers["Content-Security-Policy"]
        assert headers["X-Content-Type-Options"] == "nosniff"
        assert "Access-Control-Allow-Origin" not in headers
        assert "Set-Cookie" not in headers
    for path in ("/../cli.py", "/ball.pcsg", "/%2e%2e/cli.py", "/ws.js", "//etc/passwd"):
        assert ask(served, path)[0] == 404


def test_strangers_are_refused(served):
    assert ask(served, Host="evil.example")[0] == 403
    assert ask(served, Origin="http://evil.example")[0] == 403
    assert ask(served, "/ws")[0] == 403
    for origin in ("http://evil.example", f"http://localhost:{served.port + 1}"):
        with pytest.raises(InvalidStatus) as refused, connect(served, origin=origin):
            pass
        assert refused.value.response.status_code == 403


@pytest.mark.parametrize("token", ["", "wrong", "é"])
def test_a_wrong_token_ends_the_socket(served, token):
    with connect(served, token=token) as socket, pytest.raises(ConnectionClosed) as closed:
        socket.recv(timeout=30)
    assert closed.value.rcvd.code == 4401


def test_silence_ends_the_socket(served):
    address = f"ws://localhost:{served.port}/ws"
    with (
        websockets.connect(address, origin=served.address) as socket,
        pytest.raises(ConnectionClosed) as closed,
    ):
        socket.recv(timeout=30)
    assert closed.value.rcvd.code == 4401


def test_a_window_gets_its_picture_and_finds_it_again_after_a_break(served):
    with connect(served, window="lid") as socket:
        assert hear(socket, "text")["text"] == "{n = 2} uscale(n) sphere\n"
        socket.send(json.dumps(WANT))
        assert hear(socket, "scene")["parameters"]["n"] == 2.0
        first = hear(socket, "frame")
        assert first["size"] == [64, 48]
        processes = served.children()
    with connect(served, window="lid") as socket:
        socket.send(json.dumps(WANT))
        while not (frame := hear(socket, "frame"))["done"]:
            pass
        assert frame["data"].startswith(b"\x89PNG")
        assert set(processes) <= set(served.children())


def test_a_killed_process_is_told_and_replaced(served):
    with connect(served, window="killed") as socket:
        socket.send(json.dumps(WANT))
        hear(socket, "frame")
        for process in served.children():  # that of this window is among them
            os.kill(process, signal.SIGKILL)
        assert "ended" in hear(socket, "errors")["errors"][0]["text"]
        socket.send(json.dumps({**WANT, "values": {"n": 3}}))
        assert hear(socket, "scene")["parameters"]["n"] == 3.0


def test_the_picture_saved_is_that_of_render(served, tmp_path):
    with connect(served, window="saved") as socket:
        socket.send(json.dumps({**WANT, "values": {"n": 3}}))
        socket.send(json.dumps({"type": "file"}))
        data = hear(socket, "file")["data"]
    (tmp_path / "page.png").write_bytes(data)
    (tmp_path / "ball.pcsg").write_text("{n = 2} uscale(n) sphere\n")
    options = ["-D", "n=3", "--size", "64x48", "--samples", "1", "-q", "-o", "own.png"]
    command = [sys.executable, "-m", "pcsg", "render", "ball.pcsg", *options]
    subprocess.run(command, cwd=tmp_path, check=True)
    with Image.open(tmp_path / "page.png") as page, Image.open(tmp_path / "own.png") as own:
        assert page.tobytes() == own.tobytes()
        assert page.text["pcsg:parameters"] == own.text["pcsg:parameters"]


@pytest.mark.parametrize("end", [signal.SIGINT, signal.SIGKILL])
def test_nothing_survives_the_server(tmp_path, end):
    (tmp_path / "ball.pcsg").write_text("sphere\n")
    with serving(tmp_path / "ball.pcsg") as running:
        with connect(running) as socket:
            socket.send(json.dumps(WANT))
            hear(socket, "frame")
            children = running.children()
            assert children
            running.process.send_signal(end)
            running.process.wait(timeout=30)
        if end == signal.SIGINT:
            assert running.process.returncode == 0
        wait_for(lambda: not any(map(runs, children)), "the end of the processes")


def runs(number):
    command = ["ps", "-o", "stat=", "-p", str(number)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    # What has ended and was not waited for is there, too.
    return not done.stdout.startswith("Z") and done.stdout.strip() != ""
