"""Calls on a cluster of Dask, each of which ends."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor, Future
from typing import ParamSpec, Protocol, TypeVar

Result = TypeVar("Result")
Given = ParamSpec("Given")


class Client(Protocol):
    """The client of `distributed`."""

    def submit(self, function: Callable[..., Result], /, *arguments: object, **named: object) -> Future[Result]:
        """Give a call to the cluster."""
        ...


class ClusterCalls(Executor):
    """The executor of a client of `distributed`, whose calls end by a result or an error, whatever the cluster loses.

    That of `distributed` waits for ever for a call that had ended on a worker that died with its result, where the scheduler dies
    before the call is made again.
    """

    def __init__(self, client: Client, options: dict[str, object]) -> None:
        self._client, self._options = client, options

    def submit(
        self, function: Callable[Given, Result], /, *arguments: Given.args, **named: Given.kwargs
    ) -> Future[Result]:
        """Give a call to the cluster."""
        asked, told = self._client.submit(function, *arguments, **self._options, **named), Future[Result]()

        def ended(asked: Future[Result]) -> None:
            if told.set_running_or_notify_cancel():
                try:
                    told.set_result(asked.result())
                except Exception as error:  # of the call, or what became of the cluster
                    told.set_exception(error)

        told.add_done_callback(lambda one: asked.cancel() if one.cancelled() else None)
        asked.add_done_callback(ended)
        return told


def with_every_end(executor: Executor) -> Executor:
    """Return the executor itself, or of Dask one whose calls all end."""
    if not is_dask(executor):
        return executor
    client, options = getattr(executor, "_client", None), getattr(executor, "_kwargs", None)
    return executor if client is None or options is None else ClusterCalls(client, options)


def is_dask(executor: Executor) -> bool:
    """Tell an executor of a cluster of Dask."""
    return type(executor).__module__.startswith("distributed")
