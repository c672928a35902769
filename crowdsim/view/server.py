"""The server of the player: the page, and a recording posed block by block while it is seen, or what is played live.

It listens on this machine only, unless it is told otherwise. Its address has a token, without which nothing is
answered; requests of other pages, and under names that others could have made mean this machine, are refused.
"""

from __future__ import annotations

import asyncio
import ipaddress
import re
import secrets
import socket
import threading
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any

from crowdsim.errors import CrowdsimError
from crowdsim.view.page import embedded, page_head, program
from crowdsim.view.recording import Recording
from crowdsim.view.stage import Passing, Stage
from crowdsim.view.why import Reasons

if TYPE_CHECKING:
    from starlette.applications import Starlette
    from starlette.requests import HTTPConnection, Request
    from starlette.responses import Response
    from starlette.websockets import WebSocket

LOOPBACK = "127.0.0.1"
_BLOCK_SECONDS = 1.0
"""Length of the blocks that are posed one by one [s]."""
_REFUSED = 1008
"""Code with which websockets are closed that are refused."""
_NO_TEXT = 1003
"""Code with which those are closed that send something else than text."""
_TOO_SLOW = 1013
"""Code with which those are closed that read nothing."""
_MOST_ASKED, _MOST_WAITING, _MOST_KEPT = 65_536, 30, 300
"""Most bytes of a message from a page, and how many messages wait for one before some, and all, are not kept."""
_CLOSING_SECONDS = 2.0
"""For how long a page is told that it is left [s]."""
_HEADERS = {
    "Cache-Control": "no-store",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
}


@dataclass(frozen=True)
class Server:
    """A server that listens already.

    Attributes:
        app: What answers requests.
        socket: Where it listens.
        address: Address of the page, token included.
    """

    app: Starlette
    socket: socket.socket
    address: str

    def serve(self) -> None:
        """Answer requests until a signal comes."""
        import uvicorn

        config = uvicorn.Config(
            self.app, log_level="error", access_log=False, lifespan="off", server_header=False,
            timeout_graceful_shutdown=1, ws_max_size=_MOST_ASKED, ws_per_message_deflate=False,
        )  # fmt: skip
        uvicorn.Server(config).run(sockets=[self.socket])


def open_server(
    source: Recording | Stage, host: str = LOOPBACK, port: int = 0, reasons: Reasons | None = None
) -> Server:
    """Return a server of a recording, or of what is played live, which listens.

    Args:
        source: The recording, or the stage.
        host: Address or name to listen at.
        port: Port; one that is free when 0.
        reasons: Knows why avatars of the recording did what they did.

    Raises:
        CrowdsimError: Packages are missing, or the port is in use or cannot be had.
    """
    return server_at(listen(host, port), source, host, reasons)


def server_at(
    listening: socket.socket, source: Recording | Stage, host: str = LOOPBACK, reasons: Reasons | None = None
) -> Server:
    """Return a server where ``listen`` has begun to; see ``open_server``."""
    token = secrets.token_urlsafe(16)
    number = listening.getsockname()[1]
    shown = LOOPBACK if host in ("0.0.0.0", "::") else host
    shown = f"[{shown}]" if ":" in shown else shown
    return Server(build_app(source, token, host, number, reasons), listening, f"http://{shown}:{number}/{token}/")


def listen(host: str, port: int) -> socket.socket:
    """Return a socket that listens, for a server.

    Raises:
        CrowdsimError: Packages are missing, or the port is in use or cannot be had.
    """
    try:
        import starlette
        import uvicorn
        import websockets
    except ImportError as error:
        raise CrowdsimError(
            f"package {error.name!r} is missing, which serves the player: pip install 'crowdsim[view]'; "
            "crowdsim view --html FILE writes a page without it"
        ) from None
    assert starlette
    assert uvicorn
    assert websockets
    try:
        found = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        listening = socket.socket(found[0], socket.SOCK_STREAM)
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listening.bind(found[4])
        listening.listen(64)
    except (OSError, UnicodeError) as error:
        remedy = "; --port names another one" if port else ""
        reason = getattr(error, "strerror", None) or error
        raise CrowdsimError(f"cannot listen at {host} port {port}: {reason}{remedy}") from None
    return listening


def build_app(source: Recording | Stage, token: str, host: str, port: int, reasons: Reasons | None = None) -> Starlette:
    """Return what answers requests for a recording, or for what is played live.

    Args:
        source: The recording, or the stage.
        token: First part of every path.
        host: Where it listens; requests name it, or this machine.
        port: Its port.
        reasons: Knows why avatars of the recording did what they did.
    """
    from starlette.applications import Starlette
    from starlette.responses import JSONResponse, PlainTextResponse, Response
    from starlette.routing import Route, WebSocketRoute

    recording = source if isinstance(source, Stage) else replace(source, block_seconds=_BLOCK_SECONDS)
    posing = threading.Lock()

    def checked(answer: Any) -> Any:
        def endpoint(request: Request) -> Response:
            fault = _fault(request, token, host, port)
            found = PlainTextResponse(f"{fault}\n", 403) if fault else answer(request)
            found.headers.update(_HEADERS)
            return found

        return endpoint

    def show(request: Request) -> Response:
        # Some browsers take 'self' for pages alone; the name has been checked.
        connects = f"'self' ws://{request.headers['host']}" if isinstance(source, Stage) else "'self'"
        page = f"{page_head(source.name, connects)}{embedded({'why': reasons is not None})}{program()}"
        return Response(page, media_type="text/html; charset=utf-8")

    def scene(request: Request) -> Response:
        with posing:
            found = recording.scene(slow=False) if isinstance(recording, Recording) else recording.scene()
        return Response(found, media_type="application/octet-stream")

    def camera(request: Request) -> Response:
        assert isinstance(recording, Recording)
        cameras, text = list(recording.cameras.values()), request.path_params["number"]
        number = int(text) if text.isdecimal() and len(text) < 10 else len(cameras)
        if number >= len(cameras):
            return PlainTextResponse(f"camera {text}: expected 0 to {len(cameras) - 1}\n", 404)
        with posing:
            return Response(cameras[number].packed(), media_type="application/octet-stream")

    def block(request: Request) -> Response:
        assert isinstance(recording, Recording)
        text = request.path_params["number"]
        number = int(text) if text.isdecimal() and len(text) < 10 else recording.block_count
        if number >= recording.block_count:
            return PlainTextResponse(f"block {text}: expected 0 to {recording.block_count - 1}\n", 404)
        with posing:
            return Response(recording.block(number), media_type="application/octet-stream")

    def why(what: str, request: Request) -> Response:
        avatar, frame = (request.path_params[name] for name in ("avatar", "frame"))
        if reasons is None or not all(text.isdecimal() and len(text) < 10 for text in (avatar, frame)):
            return PlainTextResponse("nothing is known of that\n", 404)
        try:
            found = (reasons.at if what == "why" else reasons.values)(int(avatar), int(frame))
            return JSONResponse(found)
        except CrowdsimError as error:
            return PlainTextResponse(f"{error}\n", 404)

    def other(request: Request) -> Response:
        return PlainTextResponse("there is no such page\n", 404)

    async def live(socket: WebSocket) -> None:
        if _fault(socket, token, host, port):
            await socket.close(_REFUSED)
        elif isinstance(source, Stage):
            await _play(source, socket)

    of_recording = [Route(f"/{{token}}/{one.__name__}/{{number}}", checked(one)) for one in (block, camera)]
    routes = [
        Route("/{token}/", checked(show)),
        Route("/{token}/scene", checked(scene)),
        *(Route(f"/{{token}}/{what}/{{avatar}}/{{frame}}", checked(partial(why, what))) for what in ("why", "values")),
        *([WebSocketRoute("/{token}/live", live)] if isinstance(source, Stage) else of_recording),
        Route("/{path:path}", checked(other)),
        WebSocketRoute("/{path:path}", _refuse),
    ]
    return Starlette(routes=routes)


async def _refuse(socket: WebSocket) -> None:
    await socket.close(_REFUSED)


async def _play(stage: Stage, socket: WebSocket) -> None:
    """Send what is played to a page, and do what it asks for, until it leaves."""
    from starlette.websockets import WebSocketDisconnect

    loop = asyncio.get_running_loop()
    waiting: asyncio.Queue[str | bytes] = asyncio.Queue(_MOST_KEPT)
    asked: asyncio.Queue[str] = asyncio.Queue(_MOST_WAITING)
    is_full = asyncio.Event()

    def put(message: str | bytes) -> None:
        # A page that cannot keep up misses frames; it must not miss the rest.
        if waiting.full():
            is_full.set()
        elif waiting.qsize() < _MOST_WAITING or not isinstance(message, bytes | Passing):
            waiting.put_nowait(message)

    def send(message: str | bytes) -> None:
        loop.call_soon_threadsafe(put, message)

    async def tell() -> None:
        while True:
            message = await waiting.get()
            await (socket.send_text(message) if isinstance(message, str) else socket.send_bytes(message))

    async def listen() -> None:
        while (message := await socket.receive())["type"] == "websocket.receive":
            if message.get("text") is None:
                await socket.close(_NO_TEXT)
                return
            await asked.put(message["text"])

    async def answer() -> None:
        # Listening goes on meanwhile, so that it is seen when the page leaves.
        while True:
            send(await asyncio.to_thread(stage.act, await asked.get(), send))

    await socket.accept()
    tasks: list[asyncio.Task[Any]] = []
    try:
        # It is cancelled where the server ends while something is being done.
        with suppress(asyncio.CancelledError):
            await asyncio.to_thread(stage.watch, send)
            tasks += [asyncio.create_task(one()) for one in (tell, listen, answer)]
            tasks.append(asyncio.create_task(is_full.wait()))
            await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
    finally:
        stage.leave(send)
        for task in tasks:
            task.cancel()
        for done in await asyncio.gather(*tasks, return_exceptions=True):
            if isinstance(done, Exception) and not isinstance(done, (WebSocketDisconnect, RuntimeError, OSError)):
                raise done
    if is_full.is_set():
        # It does not answer either.
        with suppress(TimeoutError, WebSocketDisconnect, RuntimeError, OSError):
            await asyncio.wait_for(socket.close(_TOO_SLOW), _CLOSING_SECONDS)


def _fault(request: HTTPConnection, token: str, host: str, port: int) -> str:
    """Return why a request is refused; nothing where it is answered."""
    name = request.headers.get("host", "")
    if not _is_own(name, host, port):
        return "this name does not mean this server"
    origin = request.headers.get("origin")
    if origin is not None and origin != f"http://{name}":
        return "requests of other pages are refused"
    if not secrets.compare_digest(request.url.path.split("/")[1].encode(), token.encode()):
        return "the address lacks its token: crowdsim prints the whole address"
    return ""


def _is_own(name: str, host: str, port: int) -> bool:
    """Whether a Host header names this server: by what it listens at, or by an address, which no one else can bend."""
    # A port of 80 goes without saying.
    bare, _, number = (name if re.search(r":\d+$", name) else f"{name}:80").rpartition(":")
    if number != str(port):
        return False
    if bare in (host, "localhost", LOOPBACK, "[::1]"):
        return True
    if host in (LOOPBACK, "localhost", "::1"):
        return False
    try:
        ipaddress.ip_address(bare.strip("[]"))
    except ValueError:
        return bare.lower() == socket.gethostname().lower()
    return True
