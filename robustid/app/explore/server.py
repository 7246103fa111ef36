"""The server of the page: on this machine only, for whoever has its address, until Ctrl-C."""

from __future__ import annotations

import contextlib
import hmac
import logging
import os
import secrets
import socket
from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING

from robustid.app.explore.pages import Pages
from robustid.app.explore.session import Session
from robustid.app.explore.tuning import Tuning
from robustid.app.explore.views import View
from robustid.errors import InputError

if TYPE_CHECKING:
    from _typeshed.wsgi import StartResponse, WSGIEnvironment
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
