"""The server of the page: on this machine only, for whoever has its address, until Ctrl-C."""

from __future__ import annotations

import contextlib
import functools
import hmac
import json
import logging
import os
import secrets
import socket
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

from robustid.app.explore.callbacks import connect
from robustid.app.explore.layout import layout
from robustid.app.explore.quantities import Quantity, quantities
from robustid.app.explore.session import Session
from robustid.app.explore.tuning import Tuner, Tuning
from robustid.app.explore.tuning_page import connect_tuning, tuning_layout, tuning_quantities
from robustid.app.explore.worker import Worker
from robustid.errors import InputError

if TYPE_CHECKING:
    from dash.development.base_component import Component
    from flask import Flask, Response
    from werkzeug.wrappers import Response as WerkzeugResponse

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
_PAGE = """<!DOCTYPE html>
<html lang="en">
<head>{%metas%}<meta name="viewport" content="width=device-width, initial-scale=1"><title>{%title%}</title>{%css%}
<link rel="icon" href="data:,"></head>
<body>{%app_entry%}<script>window.explored = EXPLORED;</script><footer>{%config%}{%scripts%}{%renderer%}</footer></body>
</html>"""


class _Page(NamedTuple):
    """Parts of a page that is served: numbers with sliders, its layout, its reactions, and the thread that computes."""

    numbers: list[Quantity]
    layout: Component
    connect: Callable[[Any], None]
    worker: Worker | Tuner


def _page_of(session: Session | Tuning, title: str) -> _Page:
    """The page of a class that is changed by hand, or of a controller that is tuned."""
    if isinstance(session, Tuning):
        tuner = Tuner(session)
        react = functools.partial(connect_tuning, tuner=tuner)
        return _Page(tuning_quantities(session), tuning_layout(session, title), react, tuner)
    worker = Worker(session)
    react = functools.partial(connect, session=session, worker=worker)
    return _Page(quantities(session), layout(session, title), react, worker)


class Server:
    """A page that is served; it begins with `serve` and ends with `close`, from another thread or by Ctrl-C."""

    def __init__(self, session: Session | Tuning, title: str, port: int = 0) -> None:
        try:
            import dash
            from werkzeug.serving import WSGIRequestHandler, make_server
        except ImportError:
            raise InputError(
                "robustid explore needs the package Dash, which is not installed: pip install 'robustid[explore]'"
            ) from None
        listening = _listening(port)
        page = _page_of(session, title)
        self._worker = page.worker
        self._token, self._site = secrets.token_urlsafe(24), f"{_HOST}:{listening.getsockname()[1]}"
        app = dash.Dash(__name__, title=title, update_title=None, assets_folder="assets", compress=False)  # type: ignore[arg-type]
        numbers = {one.name: {"low": one.low, "high": one.high, "offset": one.offset} for one in page.numbers}
        app.index_string = _PAGE.replace("EXPLORED", json.dumps(numbers))
        app.layout = page.layout
        page.connect(app)
        self._guard(app.server)
        logging.getLogger("werkzeug").setLevel(logging.ERROR)  # no line for every request

        class Quiet(WSGIRequestHandler):
            """Says nothing of requests that a browser gave up."""

            def log(self, type: str, message: str, *args: object) -> None:
                """Say nothing."""

        port = listening.getsockname()[1]
        self._server = make_server(_HOST, port, app.server, threaded=True, request_handler=Quiet, fd=listening.detach())
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
        self._worker.close()

    def _guard(self, flask: Flask) -> None:
        """Refuse requests that are addressed to another name, come from another site, or have no token."""
        from flask import Response, redirect, request

        cookie = f"robustid-{self._site.split(':')[1]}"  # cookies are shared by the ports of a machine

        def refused(words: str) -> Response:
            return Response(words, 403, mimetype="text/plain")

        @flask.before_request
        def check() -> Response | WerkzeugResponse | None:
            # A name that a stranger's server gives this address (DNS rebinding) stands in Host.
            if request.headers.get("Host") != self._site:
                return refused(_ELSEWHERE.format(self._site))
            if request.headers.get("Origin", f"http://{self._site}") != f"http://{self._site}":
                return refused(_ELSEWHERE.format(self._site))
            if _equal(request.args.get("token", ""), self._token):
                answer = redirect("/")
                answer.set_cookie(cookie, self._token, httponly=True, samesite="Strict")
                return answer
            return None if _equal(request.cookies.get(cookie, ""), self._token) else refused(_STRANGER)

        @flask.after_request
        def private(answer: Response) -> Response:
            answer.headers["Content-Security-Policy"] = _POLICY
            answer.headers["Referrer-Policy"] = "no-referrer"
            answer.headers["X-Content-Type-Options"] = "nosniff"
            return answer


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


def serve(session: Session | Tuning, title: str, port: int, ready: Callable[[str], None]) -> None:
    """Serve the page until Ctrl-C; `ready` is told its address."""
    server = Server(session, title, port)
    with contextlib.suppress(KeyboardInterrupt):  # its usual end
        try:
            ready(server.address)
            server.serve()
        finally:
            server.end()
