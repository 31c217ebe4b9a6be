"""A scene in the browser while the program runs, from a server on the loopback address only.

meshcat's own server is a process of its own that listens on every interface, outlives a killed parent and has
a second port for commands. This one is a thread of the program: it ends with the program in any case.
"""

import asyncio
import json
import os
import socket
import threading
from typing import Any, Protocol, Self

import tornado.httpserver
import tornado.web
import tornado.websocket

from pouring_robot.exceptions import BadInputError
from pouring_robot.viewer.page import page
from pouring_robot.viewer.scene import Scene

LOOPBACK = "127.0.0.1"
_PATIENCE_S = 10.0  # longest time the server's thread may take to start or to end


class Bench(Protocol):
    """Something that moves a live scene. Its methods are called by the server's thread, one at a time."""

    def sliders(self) -> dict[str, Any]:
        """Return the sliders of the page, with names, limits and values, ready for JSON."""

    def answer(self, wanted: Any) -> dict[str, Any]:
        """Return what the page shows for values its user chose, ready for JSON; a refusal has the key ``refused``.

        ``wanted`` is the parsed JSON that was received, None if it was not JSON.
        """


class LiveView:
    """A scene that browsers on this machine can look at for as long as it is open; use it in a ``with`` statement.

    It listens on a port of the loopback address (0: a free one); its sliders, if any, move the bench.

    Attributes:
        url: address of the page.

    Raises:
        BadInputError: the port is taken or not allowed, or the server does not start.
    """

    def __init__(self, scene: Scene, port: int = 0, bench: Bench | None = None) -> None:
        self._clients: set[_Words] = set()  # used by the server's thread alone
        shown = page(scene, live=True, bench=bench.sliders() if bench else None)
        self._settings: dict[str, Any] = {"page": shown, "bench": bench, "clients": self._clients}
        try:
            if not 0 <= port <= 65535:
                raise OSError("ports go from 0 to 65535")
            self._socket = socket.create_server((LOOPBACK, port))
        except OSError as error:
            reason = os.strerror(error.errno) if error.errno else error
            mend = "choose another port, or 0 for a free one"
            raise BadInputError(f"cannot listen on {LOOPBACK} port {port}: {reason}; {mend}") from error
        self._socket.setblocking(False)
        self.url = f"http://{LOOPBACK}:{self._socket.getsockname()[1]}/"
        self._loop = asyncio.new_event_loop()
        self._closing = threading.Event()
        self._started = threading.Event()
        self._stop = asyncio.Event()
        self._failure: Exception | None = None
        # A daemon: a program that forgets to close the view must still be able to end.
        self._thread = threading.Thread(target=self._run, name="pouring-robot-view", daemon=True)
        self._thread.start()
        if not self._started.wait(_PATIENCE_S) or self._failure:
            self.close()
            self._socket.close()
            why = self._failure or f"its server did not start within {_PATIENCE_S:g} s"
            raise BadInputError(f"cannot show the page at {self.url}: {why}; try again, or write it with --html")

    def wait(self, timeout_s: float | None = None) -> bool:
        """Block until the view is closed, the time is over (s) or Ctrl-C; return whether it was closed."""
        return self._closing.wait(timeout_s)

    def close(self) -> None:
        """Stop listening and end the thread; a second call does nothing."""
        if not self._closing.is_set():
            self._closing.set()
            if not self._failure:  # otherwise its thread has ended by itself
                self._loop.call_soon_threadsafe(self._stop.set)
            self._thread.join(_PATIENCE_S)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def _run(self) -> None:
        """Body of the thread."""
        asyncio.set_event_loop(self._loop)
        try:
            self._loop.run_until_complete(self._listen())
        except Exception as error:
            self._failure = error
        finally:
            self._loop.close()
            self._started.set()  # whoever waits for the start need not wait any longer

    async def _listen(self) -> None:
        # A browser's request for an icon need not appear in a terminal, so nothing is logged.
        application = tornado.web.Application(log_function=lambda handler: None, **self._settings)
        # Requests under any other host name get no answer: such a page comes from elsewhere, and its name was made
        # to point at this machine.
        application.add_handlers(r"127\.0\.0\.1|localhost", [(r"/(?:static/)?", _Page), (r"/bench", _Words)])
        server = tornado.httpserver.HTTPServer(application)
        server.add_socket(self._socket)
        self._started.set()
        await self._stop.wait()
        server.stop()
        for client in tuple(self._clients):
            client.close()
        await server.close_all_connections()


serve = LiveView  # read as what the program does


class _Page(tornado.web.RequestHandler):
    """The page itself."""

    def get(self) -> None:
        self.set_header("Cache-Control", "no-store")
        self.write(self.settings["page"])


class _Words(tornado.websocket.WebSocketHandler):
    """Messages from and to the page; tornado itself refuses pages of other origins."""

    def open(self, *args: Any, **kwargs: Any) -> None:
        self.set_nodelay(True)
        self.settings["clients"].add(self)

    def on_message(self, message: str | bytes) -> None:
        bench = self.settings["bench"]
        if bench is None:
            return
        try:
            wanted = json.loads(message)
        except (ValueError, RecursionError):  # not from our page: the bench refuses it like any other invalid message
            wanted = None
        self.write_message(json.dumps(bench.answer(wanted), allow_nan=False))

    def on_close(self) -> None:
        self.settings["clients"].discard(self)
