"""The pages that are served: the first from the start, every other one when it is asked for, which is said as long as it opens."""

from __future__ import annotations

import functools
import html
import json
import logging
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
from robustid.errors import RobustIdError

if TYPE_CHECKING:
    from _typeshed.wsgi import StartResponse, WSGIEnvironment
    from dash.development.base_component import Component
    from flask import Flask

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
