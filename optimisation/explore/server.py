"""The explorer's server: one page, and a socket for each of its tabs, on this machine only.

Each tab has a thread that computes its newest setting.
"""

import asyncio
import errno
import json
import logging
import re
import socket
import threading
import time
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import asynccontextmanager, suppress
from dataclasses import asdict, dataclass
from ipaddress import ip_address
from pathlib import Path
from typing import Any

from impact_env.checks import ParameterError, describe_error
from impact_env.extras import optional
from impact_env.plain import Plain
from impact_env.structures.cyclic import BladedDisk
from impact_env.sweep import IntegrationError, Stopped
from optimisation.explore.advice import recommend_values
from optimisation.explore.control import ControlValues, RefusedValues
from optimisation.explore.disk_work import DiskWork
from optimisation.explore.examples import (
    OWN,
    Example,
    PageStructure,
    examples_to_list,
    make_structures,
)
from optimisation.explore.explanations import CARD_NUMBERS, format_help
from optimisation.explore.settings import (
    PageModel,
    commands_of,
    controls_to_dict,
    load_files,
    parse_controls,
    scene_file,
)
from optimisation.explore.waiting import Kernels, Newer
from optimisation.explore.work import Message, Work

with optional():
    import uvicorn
    from starlette.applications import Starlette
    from starlette.requests import Request
    from starlette.responses import JSONResponse, PlainTextResponse, Response
    from starlette.routing import Mount, Route, WebSocketRoute
    from starlette.staticfiles import StaticFiles
    from starlette.types import ASGIApp, Receive, Scope, Send
    from starlette.websockets import WebSocket, WebSocketDisconnect

LOG = logging.getLogger("optimisation.explore")
ASSETS = Path(__file__).parent / "assets"
LOOPBACK = {"127.0.0.1", "::1", "localhost"}
ALL_ADDRESSES = {"0.0.0.0", "::"}
OWN_ADDRESS = "an address or a name of this machine"
REFUSED = (
    "this page answers only to names of its own; another one is allowed by impact-absorber "
    "explore --name NAME"
)
# of a message
MOST_TABS = 8
MOST_BYTES = 16384
REPORT_INTERVAL = 0.1  # s between messages about a search
# s that a first pass may take once a newer setting is there: a drag shows something, and does not
# lag behind
FIRST_PASS = 0.4
HEADERS = {
    "Content-Security-Policy": (
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; "
        "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    ),
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-cache",
    "Cross-Origin-Resource-Policy": "same-origin",
}


@dataclass(frozen=True)
class Names:
    """Names in a Host header under which the server responds.

    Any port is allowed, because a tunnel has a port of its own.

    ``anywhere``: also numeric addresses, which no name server can bind to this machine.
    """

    names: frozenset[str]
    anywhere: bool

    def includes(self, host: str) -> bool:
        """Return whether a Host header has one of the names."""
        match = re.fullmatch(r"(\[[0-9a-f:.]+\]|[^:\[\]/@]+)(:\d+)?", host.lower())
        if match is None:
            return False
        name = match[1].strip("[]")
        return name in self.names or (self.anywhere and is_numeric(name))


def is_numeric(name: str) -> bool:
    """Return whether a host's name is an IP address."""
    try:
        ip_address(name)
    except ValueError:
        return False
    return True


class Guard:
    """Passes on requests to a name of this server, and from its own page only.

    The page of another site that reaches the port, by its address or by a name that was bound to
    it, has another Origin or Host.
    """

    def __init__(self, app: ASGIApp, names: Names) -> None:
        self.app = app
        self.names = names

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass on, or refuse with 403."""
        if scope["type"] == "lifespan":
            await self.app(scope, receive, send)
            return
        headers = [(name.lower(), value.decode("latin-1")) for name, value in scope["headers"]]
        hosts = [value for name, value in headers if name == b"host"]
        origins = [value for name, value in headers if name == b"origin"]
        own = (
            len(hosts) == 1
            and self.names.includes(hosts[0])
            and origins in ([], [f"http://{hosts[0]}"], [f"https://{hosts[0]}"])
        )
        if scope["type"] == "websocket":
            if not own or not origins:
                await send(
                    {"type": "websocket.close", "code": 1008}
                )  # before it is accepted: an answer 403
                return
        elif not own:
            await PlainTextResponse(REFUSED, 403)(scope, receive, send)
            return

        async def with_headers(message: Any) -> None:
            if message["type"] == "http.response.start":
                message["headers"] = [
                    *message["headers"],
                    *((name.lower().encode(), value.encode()) for name, value in HEADERS.items()),
                ]
            await send(message)

        await self.app(scope, receive, with_headers)


class Outbox:
    """Queue of messages to a page.

    A new message replaces one of the same sort that was not sent yet, so that the number of
    messages is bounded.
    """

    def __init__(self) -> None:
        self._loop = asyncio.get_running_loop()
        self._lock = threading.Lock()
        self._waiting = asyncio.Event()
        self._messages: dict[tuple[Any, ...], Message] = {}

    def put(self, message: Message) -> None:
        """Take a message from any thread."""
        with self._lock:
            self._messages[message["type"], message.get("which"), message.get("what")] = message
        with suppress(RuntimeError):  # the loop has ended
            self._loop.call_soon_threadsafe(self._waiting.set)

    async def get(self) -> list[Message]:
        """Wait for messages and return them, oldest first."""
        await self._waiting.wait()
        self._waiting.clear()
        with self._lock:
            messages = list(self._messages.values())
            self._messages = {}
        return messages


class Tab:
    """One open page: its newest setting, and the thread that computes it."""

    def __init__(
        self, structures: dict[str, PageStructure], kernels: Kernels, outbox: Outbox
    ) -> None:
        self.structures = structures
        self.kernels = kernels
        self.outbox = outbox
        self._changed = threading.Condition()
        self._ended = False
        self._next: tuple[int, ControlValues, PageModel, bool] | None = None
        self._work: Work | None = None
        self._known: dict[tuple[Any, ...], list[Message]] = {}
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    def handle(self, plain: Any) -> None:
        """Check a message of the page and begin with it.

        It is ``{"number": n, "structure": key, "values": {...}}``, with ``"recommend": true`` for
        advice instead of figures.
        """
        ok = (
            isinstance(plain, dict)
            and isinstance(plain.get("number"), int)
            and abs(plain["number"]) < 2**53
        )
        if not ok:
            self._refuse(-1, {"": "a message is a table with number and values"})
            return
        number = plain["number"]
        key = plain.get("structure", OWN)
        if not isinstance(key, str) or key not in self.structures:
            self._refuse(number, {"": f"structure is not one of {', '.join(self.structures)}"})
            return
        structure = self.structures[key].structure
        try:
            values = parse_controls(plain.get("values"), structure)
            message = {
                "type": "taken",
                "number": number,
                "scene": scene_file(values, structure),
                "loads": load_files(values, structure),
                "commands": commands_of(values, structure),
            }
        except RefusedValues as refused:
            self._refuse(number, refused.errors)
            return
        except ParameterError as error:
            self._refuse(number, {"": str(error)})
            return
        self.outbox.put(message)
        with self._changed:
            self._next = number, values, structure, plain.get("recommend") is True
            self._hurry()
            self._changed.notify()

    def _refuse(self, number: int, errors: dict[str, str]) -> None:
        self.outbox.put({"type": "refused", "number": number, "errors": errors})

    def _hurry(self) -> None:
        """Stop the running computation.

        Its first pass is stopped only if it takes long, because without it the page would have
        nothing to show.
        """
        work = self._work
        if work is None:
            return
        work.stop.give()
        if work.rough_done:
            work.first.give()
        else:
            timer = threading.Timer(FIRST_PASS, work.first.give)
            timer.daemon = True
            timer.start()

    def end(self) -> None:
        """Stop everything; the thread ends."""
        with self._changed:
            self._ended = True
            if self._work is not None:
                self._work.stop.give()
                self._work.first.give()
            self._changed.notify()

    def join(self) -> None:
        """Wait for the thread."""
        self._thread.join(5.0)

    def _serve(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._next is not None or self._ended)
                if self._ended or self._next is None:
                    return
                (number, values, structure, advice), self._next = self._next, None
                try:
                    work = self._work = make_work(values, structure, self.kernels)
                except ParameterError as error:
                    self._refuse(number, {"": str(error)})
                    continue
            try:
                self._do(number, work, advice)
            except (Newer, Stopped):
                pass
            except (ParameterError, IntegrationError) as error:
                self.outbox.put({"type": "failed", "number": number, "error": str(error)})
            except Exception:  # the page goes on, and so does its thread
                LOG.exception("the explorer could not compute %s", values)
                self.outbox.put(
                    {
                        "type": "failed",
                        "number": number,
                        "error": (
                            "an error of the explorer itself: details are printed where it was "
                            "started"
                        ),
                    }
                )

    def _do(self, number: int, work: Work, advice: bool) -> None:
        """Send all messages of a setting, or the advice for it."""
        if not advice:
            for message in work.messages(self._known):
                self.outbox.put(message | {"number": number})
            return
        structure = work.own
        if isinstance(structure, BladedDisk):
            allowed = "for beams and single places: impact-absorber design gap searches for disks"
            raise describe_error("Recommended", "bladed disk", allowed)
        last_report = time.monotonic()

        def report(done: int, total: int) -> None:
            nonlocal last_report
            if time.monotonic() - last_report > REPORT_INTERVAL:
                last_report = time.monotonic()
                self.outbox.put({"type": "advice", "number": number, "done": done, "total": total})

        for message in work.before_advice():
            self.outbox.put(message | {"number": number})
        advised = recommend_values(work.values, structure, work.alone, work.stop, report)
        self.outbox.put({"type": "advice", "number": number, **advised._asdict()})


def make_work(values: ControlValues, structure: PageModel, kernels: Kernels) -> Work:
    """Return the computation of a setting."""
    if isinstance(structure, BladedDisk):
        return DiskWork(values, structure, kernels)
    return Work(values, structure, kernels)


def make_app(
    structure: PageModel,
    name: str,
    names: Names,
    started: Callable[[], object] = lambda: None,
    examples: Sequence[Example] = (),
) -> Starlette:
    """Return the application for a structure of a ``name``.

    ``names``: allowed names in a Host header. ``started`` is called once the application serves.

    ``examples``: those that the page has besides the usual ones.
    """
    kernels = Kernels()
    tabs = set[Tab]()
    structures = make_structures(structure, name)

    async def page(_request: Request) -> Response:
        return Response((ASSETS / "index.html").read_bytes(), media_type="text/html")

    async def explain(_request: Request) -> Response:
        return Response(format_help(), media_type="text/html")

    async def table(request: Request) -> Response:
        key = request.query_params.get("structure", OWN)
        if key not in structures:
            return PlainTextResponse(f"structure is not one of {', '.join(structures)}", 404)
        page_structure = structures[key]
        plain: Plain = {
            **controls_to_dict(page_structure.structure, page_structure.title),
            "key": key,
            "structures": {key: one.title for key, one in structures.items()},
            "examples": examples_to_list(structures, examples),
            "numbers": [
                {name: text for name, text in asdict(row).items() if name != "more"}
                for row in CARD_NUMBERS
            ],
        }
        return JSONResponse(plain)

    async def talk(page: WebSocket) -> None:
        await page.accept()
        if len(tabs) >= MOST_TABS:
            await page.close(
                1013, f"at most {MOST_TABS} tabs: close another one, and load this one again"
            )
            return
        outbox = Outbox()
        tab = Tab(structures, kernels, outbox)
        tabs.add(tab)

        async def post() -> None:
            while True:
                for message in await outbox.get():
                    await page.send_text(json.dumps(message, allow_nan=False))

        posting = asyncio.create_task(post())
        try:
            while True:
                text = await page.receive_text()
                if len(text) > MOST_BYTES:
                    await page.close(1009)
                    break
                try:
                    plain = json.loads(text, parse_constant=float)
                except (ValueError, RecursionError):
                    plain = None
                tab.handle(plain)
        except (WebSocketDisconnect, KeyError, RuntimeError):  # closed, or what it sent is no text
            pass
        finally:
            posting.cancel()
            tab.end()
            tabs.discard(tab)

    @asynccontextmanager
    async def life(_app: Starlette) -> AsyncIterator[None]:
        started()
        yield
        for tab in list(tabs):
            tab.end()
        for tab in list(tabs):
            await asyncio.to_thread(tab.join)
        kernels.cancel()

    routes = [
        Route("/", page),
        Route("/controls", table),
        Route("/help", explain),
        WebSocketRoute("/socket", talk),
        Mount("/assets", StaticFiles(directory=ASSETS)),
    ]
    app = Starlette(routes=routes, lifespan=life)
    app.add_middleware(Guard, names=names)
    return app


def open_socket(host: str, port: int) -> socket.socket:
    """Return a socket that listens at an address; port 0 stands for any free port.

    Raises ParameterError for an address that this machine does not have, and for a port that is not
    available.
    """
    try:
        family, kind, _, _, address = socket.getaddrinfo(
            host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
        )[0]
    except (OSError, UnicodeError) as error:
        raise ParameterError(f"--host = {host} is not allowed: {OWN_ADDRESS} ({error})") from error
    made = socket.socket(family, kind)
    try:
        made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        made.bind(address)
        made.listen(64)
    except OSError as error:
        made.close()
        if error.errno in (errno.EADDRNOTAVAIL, errno.EAFNOSUPPORT, errno.ENETUNREACH):
            raise ParameterError(
                f"--host = {host} is not allowed: {OWN_ADDRESS} ({error.strerror})"
            ) from error
        raise ParameterError(
            f"--port = {port} is not allowed: one that is free at {host} ({error.strerror})"
        ) from error
    return made


def page_address(listening: socket.socket) -> str:
    """Return the address by which a browser of this machine reaches the server."""
    host, port = listening.getsockname()[:2]
    if host in ALL_ADDRESSES:
        host = "::1" if ":" in host else "127.0.0.1"
    return f"http://{f'[{host}]' if ':' in host else host}:{port}/"


def names_of(*hosts: str) -> Names:
    """Return the names for an address that the server listens at, and for further ones.

    At an address of this machine alone these are its names; at any other one, all numeric addresses
    and the machine's name as well.
    """
    allowed = {host.lower().strip("[]") for host in hosts}
    if hosts[0] in LOOPBACK:
        return Names(frozenset(allowed | LOOPBACK), anywhere=False)
    machine = {socket.gethostname().lower(), socket.getfqdn().lower()}
    return Names(frozenset(allowed | machine | LOOPBACK), anywhere=True)


def serve(
    structure: PageModel,
    name: str,
    hosts: tuple[str, ...],
    listening: socket.socket,
    started: Callable[[], object],
    examples: Sequence[Example] = (),
) -> None:
    """Serve on a listening socket until Ctrl-C.

    ``hosts`` are those of `names_of`, ``examples`` those of `make_app`.
    """
    app = make_app(structure, name, names_of(*hosts), started, examples)
    limits: dict[str, Any] = {
        "ws_max_size": MOST_BYTES,
        "timeout_graceful_shutdown": 1,
        "limit_concurrency": 64,
    }
    config = uvicorn.Config(app, log_level="warning", ws="websockets-sansio", **limits)
    with listening, suppress(KeyboardInterrupt):
        uvicorn.Server(config).run(sockets=[listening])
