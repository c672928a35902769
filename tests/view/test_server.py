"""The server of the player answers its own page, and nobody else."""

import http.client
import os
import re
import signal
import socket
import subprocess
import sys
import threading
import zlib

import pytest
from naive_view import unpack_scene
from scenes import crowdsim, write_scene

import crowdsim as library
from crowdsim.commands import viewing
from crowdsim.errors import CrowdsimError
from crowdsim.view import server as serving
from crowdsim.view.server import LOOPBACK, open_server


@pytest.fixture
def run(workplace, finish):
    write_scene(workplace / "four.yaml")
    finish(workplace)
    return workplace / "run"


class Answer:
    def __init__(self, address: str, path: str = "", host: str | None = None, origin: str | None = None) -> None:
        _, _, place, token, _ = address.split("/")
        connection = http.client.HTTPConnection(*place.split(":"), timeout=120)
        connection.putrequest("GET", path if path.startswith("/") else f"/{token}/{path}", skip_host=True)
        connection.putheader("Host", host or place)
        if origin is not None:
            connection.putheader("Origin", origin)
        connection.endheaders()
        answer = connection.getresponse()
        self.status, self.body, self.headers = answer.status, answer.read(), answer.headers
        connection.close()


@pytest.fixture
def address(run):
    """Address of a server of a recording, which answers until the test is done."""
    import uvicorn

    server = open_server(library.open_run(run).recording(fps=30.0))
    running = uvicorn.Server(uvicorn.Config(server.app, log_level="error", lifespan="off"))
    thread = threading.Thread(target=running.run, kwargs={"sockets": [server.socket]}, daemon=True)
    thread.start()
    yield server.address
    running.should_exit = True
    thread.join(60)
    assert not thread.is_alive()


def test_page_scene_and_blocks_are_served(address) -> None:
    assert re.fullmatch(r"http://127\.0\.0\.1:\d+/[\w-]{22}/", address)
    page = Answer(address)
    assert page.status == 200
    assert b"connect-src 'self'" in page.body
    assert b'type="text/plain"' not in page.body
    assert page.headers["Cache-Control"] == "no-store"
    assert page.headers["Referrer-Policy"] == "no-referrer"
    scene = unpack_scene(Answer(address, "scene").body)
    assert scene["names"] == ["red_0", "red_1", "blue_0", "blue_1"]
    # Blocks of a second, so that the first one is there at once.
    assert (scene["frames"], scene["block"]) == (80, 30)
    blocks = [Answer(address, f"block/{number}") for number in range(3)]
    assert [block.status for block in blocks] == [200] * 3
    assert all(zlib.decompress(block.body) for block in blocks)
    beyond = Answer(address, "block/3")
    assert (beyond.status, beyond.body) == (404, b"block 3: expected 0 to 2\n")


def test_cameras_that_take_long_to_plan_are_served_when_they_are_chosen(address, run) -> None:
    scene = unpack_scene(Answer(address, "scene").body)
    assert scene["cameras"][0] == {"name": "auto", "kind": "auto"}
    assert "camera_0" not in scene["tables"]
    camera = Answer(address, "camera/0")
    whole = unpack_scene(library.open_run(run).recording(fps=30.0).scene())["tables"]["camera_0"]
    assert zlib.decompress(camera.body) == whole.tobytes()
    beyond = Answer(address, "camera/5")
    assert (beyond.status, beyond.body) == (404, b"camera 5: expected 0 to 4\n")


@pytest.mark.parametrize("path", ["", "scene", "block/0", "camera/0"])
def test_requests_that_are_not_of_the_page_itself_are_refused(address, path) -> None:
    place = address.split("/")[2]
    port = place.split(":")[1]
    for refused in (
        Answer(address, f"/{'x' * 22}/{path}"),
        Answer(address, path, host="evil.example"),
        Answer(address, path, host=f"evil.example:{port}"),
        Answer(address, path, host=f"192.168.0.9:{port}"),
        Answer(address, path, host="127.0.0.1:1"),
        Answer(address, path, origin="http://evil.example"),
        Answer(address, path, origin="null"),
    ):
        assert refused.status == 403
        assert b"crowdsim-recording" not in refused.body
        assert b"<html" not in refused.body
    for granted in (Answer(address, path, host=f"localhost:{port}"), Answer(address, path, origin=f"http://{place}")):
        assert granted.status == 200


@pytest.mark.parametrize("path", ["/", "/scene", "//", "/block/0", "/favicon.ico"])
def test_nothing_is_answered_without_the_token(address, path) -> None:
    assert Answer(address, path).status == 403


def test_paths_that_mean_nothing_are_not_found(address) -> None:
    for path in ("nothing", "block/x", "block/-1", "../../etc/passwd"):
        assert Answer(address, path).status in (403, 404)


def test_a_server_that_listens_to_others_takes_addresses_but_no_strange_names() -> None:
    for name, expected in (
        ("0.0.0.0:80", True), ("192.168.0.9:80", True), ("[fe80::1]:80", True), ("localhost:80", True),
        (f"{socket.gethostname()}:80", True), ("evil.example:80", False), ("192.168.0.9:81", False), ("", False),
    ):  # fmt: skip
        assert serving._is_own(name, "0.0.0.0", 80) == expected


def test_a_name_that_is_none_and_a_number_without_end_are_refused(address, run) -> None:
    assert Answer(address, "block/" + "9" * 5000).status == 404
    assert Answer(address, "/x/block/" + "9" * 5000).status == 403
    for host in ("a..b", "a" * 70 + ".de"):
        with pytest.raises(CrowdsimError, match="cannot listen at"):
            open_server(library.open_run(run).recording(fps=30.0), host)


def test_port_80_goes_without_saying() -> None:
    assert serving._is_own("127.0.0.1", LOOPBACK, 80)
    assert serving._is_own("[::1]", LOOPBACK, 80)
    assert serving._is_own("localhost:8080", LOOPBACK, 8080)
    assert not serving._is_own("127.0.0.1", LOOPBACK, 8080)
    assert not serving._is_own("example.org", LOOPBACK, 80)


def test_a_port_in_use_is_reported(run, capsys) -> None:
    with socket.socket() as taken:
        taken.bind((LOOPBACK, 0))
        taken.listen()
        port = taken.getsockname()[1]
        assert crowdsim("view", run, "--port", port, "--no-open") == 2
    assert (
        f"cannot listen at 127.0.0.1 port {port}: Address already in use; --port names another one"
        in capsys.readouterr().err
    )


def test_a_missing_package_is_reported_with_what_to_install(run, monkeypatch) -> None:
    monkeypatch.setitem(sys.modules, "starlette", None)
    with pytest.raises(CrowdsimError, match=r"package 'starlette' is missing.*pip install 'crowdsim\[view\]'"):
        open_server(library.open_run(run).recording())


def test_the_command_opens_a_browser_or_says_that_there_is_none(run, monkeypatch, capsys) -> None:
    opened = []
    monkeypatch.setattr(serving.Server, "serve", lambda self: None)
    monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.setattr(viewing.webbrowser, "open", lambda address: bool(opened.append(address)) or True)
    assert crowdsim("view", run) == 0
    (address,) = opened
    said = capsys.readouterr()
    assert said.out == f"{address}\n"
    assert "no browser" not in said.err
    assert crowdsim("view", run, "--no-open") == 0
    assert len(opened) == 1
    monkeypatch.setattr(viewing.webbrowser, "open", lambda address: False)
    assert crowdsim("view", run, "--host", "0.0.0.0") == 0
    said = capsys.readouterr().err
    assert "no browser could be opened: open the address in one" in said
    assert "warning: whoever reaches this machine at 0.0.0.0 and has the address sees this" in said


@pytest.mark.skipif(sys.platform == "win32", reason="signals")
def test_ctrl_c_ends_the_server(run) -> None:
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    command = [sys.executable, "-c", "from crowdsim.cli import main; main()", "view", str(run), "--no-open"]
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment, cwd=run.parent
    )
    try:
        address = process.stdout.readline().strip()
        assert Answer(address).status == 200
        process.send_signal(signal.SIGINT)
        assert process.wait(60) == 130
    finally:
        process.kill()
        process.communicate()
