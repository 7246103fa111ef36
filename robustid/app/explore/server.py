"""The server of the pages: on this machine only, for whoever has its address, until Ctrl-C; each is opened when it is asked for."""

from __future__ import annotations

import contextlib
import functools
import hmac
import html
import json
import logging
import os
import secrets
import socket
import threading
from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

from robustid.app.explore.callbacks import connect
from robustid.app.explore.history import History
from robustid.app.explore.layout import layout
from robustid.app.explore.quantities import Quantity, fields_of, quantities
from robustid.app.explore.session import Session
from robustid.app.explore.tuning import Tuner, Tuning
from robustid.app.explore.tuning_page import connect_tuning, tuning_layout, tuning_quantities
from robustid.app.explore.views import View
from robustid.app.explore.worker import Worker
from robustid.core import one_thread
from robustid.errors import InputError, RobustIdError

if TYPE_CHECKING:
    from _typeshed.wsgi import StartResponse, WSGIEnvironment
    from dash.development.base_component import Component
    from flask import Flask
    from werkzeug import Request, Response

_HOST = "127.0.0.1"
_STRANGER = (
    "This page belongs to whoever started robustid explore: open the address that it printed, with the token in it.\n"
)
_ELSEWHERE = "This server answers requests to {} only; open the address that robustid explore printed.\n"
# Scripts and styles are served from here; a script of anywhere else is refused by the browser too.
_POLICY = (
    "default-src 'self'; script-src 'self' 'unsafe-inline' 'unsafe-eval'; style-src 'self' 'unsafe-inline';"
    " img-src 'self' data: blob:; font-src 'self' data:; connect-src 'self'; frame-ancestors 'none'; form-action 'none'"
)


_log = logging.getLogger("robustid")

_PAGE = """<!DOCTYPE html>
<html lang="en">
<head>{%metas%}<meta name="viewport" content="width=device-width, initial-scale=1"><title>{%title%}</title>{%css%}
<link rel="icon" href="data:,"></head>
<body>{%app_entry%}<script>window.explored = EXPLORED;</script><footer>{%config%}{%scripts%}{%renderer%}</footer></body>
</html>"""

_OPENING = """<!DOCTYPE html>
<html lang="en">
<head><meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">{again}
<title>{title}</title><link rel="stylesheet" href="/assets/page.css"><link rel="icon" href="data:,"></head>
<body><header><h1>{title}</h1></header>
<main><div><p role="status">{words}</p><p><a href="/">Back to the first page</a></p></div></main>
</body>
</html>"""

_AGAIN = '<meta http-equiv="refresh" content="1">'


class Server:
    """A page that is served; it begins with `serve` and ends with `close`, from another thread or by Ctrl-C."""

    def __init__(self, session: Session | Tuning, title: str, port: int = 0, views: Sequence[View] = ()) -> None:
        listening = _listening(port)
        try:
            from werkzeug.serving import WSGIRequestHandler, make_server

            self._pages = Pages(session, title, views)
        except ImportError:
            listening.close()
            raise InputError(
                "robustid explore needs the package Dash, which is not installed: pip install 'robustid[explore]'"
            ) from None
        self._token, self._site = secrets.token_urlsafe(24), f"{_HOST}:{listening.getsockname()[1]}"
        logging.getLogger("werkzeug").setLevel(logging.ERROR)  # no line for every request

        class Quiet(WSGIRequestHandler):
            """Says nothing of requests that a browser gave up."""

            def log(self, type: str, message: str, *args: object) -> None:
                """Say nothing."""

        port = listening.getsockname()[1]
        self._server = make_server(
            _HOST, port, self._answer, threaded=True, request_handler=Quiet, fd=listening.detach()
        )
        self._server.daemon_threads = True  # type: ignore[attr-defined]

    @property
    def address(self) -> str:
        """The address with its token, without which nothing is shown."""
        return f"http://{self._site}/?token={self._token}"

    def serve(self) -> None:
        """Answer until `close` is called from another thread."""
        self._server.serve_forever(poll_interval=0.1)

    def close(self) -> None:
        """Stop answering, and end the computation."""
        self._server.shutdown()

    def end(self) -> None:
        """Give the port and the thread of the computation back."""
        self._server.server_close()
        self._pages.close()

    def _answer(self, environ: WSGIEnvironment, start: StartResponse) -> Iterable[bytes]:
        """Answer a request: it is refused where it is addressed to another name, comes from another site, or has no token."""
        from werkzeug import Request, Response

        answer = self._refused(Request(environ)) or Response.from_app(self._pages.answer, environ)
        answer.headers["Content-Security-Policy"] = _POLICY
        answer.headers["Referrer-Policy"] = "no-referrer"
        answer.headers["X-Content-Type-Options"] = "nosniff"
        return answer(environ, start)

    def _refused(self, request: Request) -> Response | None:
        """The answer to a request that no page is shown to."""
        from werkzeug import Response
        from werkzeug.utils import redirect

        cookie = f"robustid-{self._site.split(':')[1]}"  # cookies are shared by the ports of a machine
        # A name that a stranger's server gives this address (DNS rebinding) stands in Host.
        hosts = request.headers.get("Host"), request.headers.get("Origin", f"http://{self._site}")
        if hosts != (self._site, f"http://{self._site}"):
            return Response(_ELSEWHERE.format(self._site), 403, mimetype="text/plain")
        if _equal(request.args.get("token", ""), self._token):
            answer = redirect("/")
            answer.set_cookie(cookie, self._token, httponly=True, samesite="Strict")
            return answer
        if _equal(request.cookies.get(cookie, ""), self._token):
            return None
        return Response(_STRANGER, 403, mimetype="text/plain")


def _equal(given: str, token: str) -> bool:
    return hmac.compare_digest(given.encode(), token.encode())


def _listening(port: int) -> socket.socket:
    """A socket at a port of this machine, 0 for any free one."""
    listening = socket.socket()
    if os.name == "posix":  # elsewhere it would share the port of another program
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listening.bind((_HOST, port))
        listening.listen()
    except OSError as error:
        listening.close()
        raise InputError(
            f"port {port} can't be used ({error.strerror}): give another `port`, or none for a free one"
        ) from None
    return listening


def serve(
    session: Session | Tuning, title: str, port: int, ready: Callable[[str], None], views: Sequence[View] = ()
) -> None:
    """Serve the page until Ctrl-C, with those that stand beside it; `ready` is told its address."""
    server = Server(session, title, port, views)
    with contextlib.suppress(KeyboardInterrupt):  # its usual end
        try:
            ready(server.address)
            server.serve()
        finally:
            server.end()


class _Page(NamedTuple):
    """A page: its numbers with sliders, its layout at every load, its reactions, and the thread that computes."""

    numbers: list[Quantity]
    layout: Callable[[], Component]
    connect: Callable[[Any], None]
    worker: Worker | Tuner


def _page_of(session: Session | Tuning, title: str, names: Sequence[str], place: int) -> _Page:
    """The page of a class that is changed by hand, or of a controller that is tuned."""
    if isinstance(session, Tuning):
        tuner = Tuner(session)
        react = functools.partial(connect_tuning, tuner=tuner)
        return _Page(tuning_quantities(session), lambda: tuning_layout(session, title), react, tuner)
    worker, every = Worker(session), quantities(session)
    history = History(fields_of(session, every))
    react = functools.partial(connect, session=session, worker=worker, history=history)
    return _Page(every, lambda: layout(session, title, history.present, names, place), react, worker)


class Pages:
    """The page of a session at ``/``, and those of views at ``/1/``, ``/2/``, ...; that of the first view is the session."""

    def __init__(self, session: Session | Tuning, title: str, views: Sequence[View] = ()) -> None:
        self._title, self._views = title, views
        self.workers: dict[int, Worker | Tuner] = {}
        self._apps: dict[int, Flask] = {}
        self._said: dict[int, str] = {}  # of pages that open
        self._troubles: dict[int, str] = {}  # of those that could not be opened
        self._one = threading.Lock()
        self._add(0, session)

    def close(self) -> None:
        """End the computations."""
        for worker in list(self.workers.values()):
            worker.close(1 / len(self.workers))

    def answer(self, environ: WSGIEnvironment, start: StartResponse) -> Iterable[bytes]:
        """Answer a request for one of the pages, or for a part of it."""
        from werkzeug import Response

        place, rest = self._place(environ["PATH_INFO"])
        if (app := self._apps.get(place)) is not None:
            prefix = environ.get("SCRIPT_NAME", "") + (f"/{place}" if place else "")
            return app(environ | {"SCRIPT_NAME": prefix, "PATH_INFO": rest}, start)
        if rest != "/":
            return Response("This page is not open yet.\n", 404, mimetype="text/plain")(environ, start)
        words = {"title": self._name(place), "words": self._opening(place)}
        escaped = {name: html.escape(one) for name, one in words.items()}
        again = "" if place in self._troubles else _AGAIN
        return Response(_OPENING.format(**escaped, again=again), mimetype="text/html")(environ, start)

    def _place(self, path: str) -> tuple[int, str]:
        """The number of the page that a path leads to, and the path there."""
        number, _, rest = path.removeprefix("/").partition("/")
        if number.isdecimal() and 0 < int(number) < len(self._views):
            return int(number), f"/{rest}"
        return 0, path

    def _name(self, place: int) -> str:
        return f"{self._title}: {self._views[place].name}" if len(self._views) > 1 else self._title

    def _opening(self, place: int) -> str:
        """Open a page, unless that goes on already; how far it is, or why it could not be opened."""
        with self._one:
            if place not in self._said:
                self._said[place] = "choosing what is not stated"
                threading.Thread(target=self._open, args=(place,), name="open", daemon=True).start()
            said = self._said[place]
            return self._troubles.get(place, "").replace("`", "") or f"{said[0].upper()}{said[1:]} …"

    def _open(self, place: int) -> None:
        def progress(text: str, done: int, count: int) -> None:
            self._said[place] = f"{text}, {done} of {count}" if count else text

        try:
            with one_thread():
                session = self._views[place].open(progress)
            self._add(place, session)
        except RobustIdError as error:
            self._troubles[place] = error.said({}, unknown=str)
        except Exception as error:  # the page must say that nothing more will come
            _log.exception("explore")
            self._troubles[place] = f"internal error, please report: {error!r}"

    def _add(self, place: int, session: Session | Tuning) -> None:
        import dash

        page = _page_of(session, self._name(place), [one.name for one in self._views], place)
        address = f"/{place}/" if place else "/"
        given: dict[str, Any] = {"title": self._name(place), "update_title": None, "assets_folder": "assets"}
        given |= {"routes_pathname_prefix": "/", "requests_pathname_prefix": address}
        app = dash.Dash(__name__, compress=False, **given)
        numbers = {one.name: {"low": one.low, "high": one.high, "offset": one.offset} for one in page.numbers}
        app.index_string = _PAGE.replace("EXPLORED", json.dumps(numbers))
        app.layout = page.layout
        page.connect(app)
        self.workers[place], self._apps[place] = page.worker, app.server
