"""Tools for other programs: a client that speaks the protocol with the server, as a process of its own, over stdin and stdout."""

import asyncio
import os
import sys
import typing
from multiprocessing import Pipe
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("mcp")
import anyio
import jsonschema
import psutil
from mcp.client.client import Client
from mcp.client.stdio import StdioServerParameters, stdio_client

import robustid as rid
from robustid.app.serve import server
from robustid.app.serve.tools import _LEFT_OUT, TOOLS
from robustid.errors import InputError, InputTypeError
from support.answers import checked
from support.command_line import refused

DT = 0.01


@pytest.fixture
def bench(tmp_path):
    """A folder with measurements, and a file and a link that are none of it."""
    place = tmp_path / "bench"
    place.mkdir()
    omega = 2 * np.pi * np.linspace(1.0, 21.0, 8)
    frf = rid.FrequencyResponse(omega, 0.3 / (1.2 - np.exp(-1j * DT * omega)), bound=0.03, dt=DT)
    rid.save(place / "frf.csv", frf)
    rid.save(tmp_path / "secret.csv", frf)
    (place / "link.csv").symlink_to(tmp_path / "secret.csv")
    (place / "unknown.csv").write_text("f,re,im\n1,1,2\n2,2,3\n3,3,4\n")
    return place


def server_of(folder):
    arguments = ["-m", "robustid", "serve", "--mcp", "--folder", str(folder)]
    return StdioServerParameters(command=sys.executable, args=arguments, env=dict(os.environ))


def working():
    """Number of processes below this one."""
    return len(psutil.Process().children(recursive=True))


class Called:
    """A client that holds every answer to the schemas of the tools."""

    def __init__(self, client, tools):
        self.client, self.tools, self.told = client, {tool.name: tool for tool in tools}, []

    async def __call__(self, name, **arguments):
        tool = self.tools[name]

        async def told(number, total, text):
            self.told.append((number, text))

        found = await self.client.call_tool(name, arguments, progress_callback=told)
        answer = checked(found.structured_content)
        jsonschema.Draft202012Validator(tool.output_schema).validate(answer)
        assert found.is_error == (answer["status"] in ("refused", "stopped", "broken"))
        return answer

    async def refused(self, name, argument, **arguments):
        answer = await self(name, **arguments)
        assert answer["status"] == "refused"
        assert answer["refusal"]["argument"] == argument
        return answer

    async def cancelled(self, name, **arguments):
        """Cancel a call once its process is at work."""

        async def told(*_):
            scope.cancel()

        with anyio.CancelScope() as scope:
            await self.client.call_tool(name, arguments, progress_callback=told)
        assert scope.cancelled_caught


async def conversation(folder, handshake):
    async with Client(stdio_client(server_of(folder)), mode=handshake) as client:
        assert client.server_info.name == "robustid"
        listed = (await client.list_tools()).tools
        assert [tool.name for tool in listed] == list(TOOLS)
        for tool in listed:
            for schema in (tool.input_schema, tool.output_schema):
                jsonschema.Draft202012Validator.check_schema(schema)
        call = Called(client, listed)
        assert (await call("look", files=["frf.csv"]))["status"] == "read"
        found = await call("identify", frequency=["frf.csv"], mode=["none"], gain=3, decay_rate=1.1, reduce=False)
        assert found["status"] == "consistent"
        assert found["margin"]["upper"] == rid.load(folder / "result").margin
        assert [number for number, _ in call.told] == list(range(1, len(call.told) + 1))
        assert any("margin and model" in text for _, text in call.told)
        still = working()
        await call.cancelled("bounds", source="result", points=400)
        with anyio.fail_after(10):
            while working() > still:
                await anyio.sleep(0.05)
        found = await call("bounds", source="result", omega=[20], directions=4)
        assert found["guarantees"][0]["at_most"] > 0
        assert found["files"] == [f"bounds{of}.{ending}" for of in ("", "-band") for ending in ("npz", "json")]
        assert (await call("verify", source="result"))["status"] == "verified"
        await call.refused("identify", "frequency_unit", frequency=["unknown.csv"], output="new")
        await call.refused("identify", "output", frequency=["frf.csv"], output="result")
        for path in ("../secret.csv", str(folder.parent / "secret.csv"), "link.csv"):
            await call.refused("look", "files", files=[path])
        await call.refused("identify", "output", frequency=["frf.csv"], output="../new")
        assert {path.name for path in folder.parent.iterdir()} == {"bench", "secret.csv"}


@pytest.mark.parametrize("handshake", ["legacy", pytest.param("auto", marks=pytest.mark.slow)])
def test_a_client_looks_identifies_bounds_cancels_verifies_and_is_refused(bench, handshake):
    asyncio.run(conversation(bench, handshake))


@pytest.mark.parametrize(
    ("tool", "given", "argument"),
    [
        ("look", {}, "files"),
        ("look", {"files": "frf.csv"}, "files"),
        ("look", {"files": ["nul\0.csv"]}, "files"),
        ("identify", {"frequenzy": ["frf.csv"]}, "frequenzy"),
        ("identify", {"gain": "large"}, "gain"),
        ("identify", {"gain": float("nan")}, "gain"),
        ("identify", {"integrators": True}, "integrators"),
        ("identify", {"force": True}, "force"),
        ("bounds", {"source": "result", "omega": []}, "omega"),
        ("verify", {"source": "result", "exact": "yes"}, "exact"),
    ],
)
def test_arguments_that_do_not_fit_are_named(bench, tool, given, argument):
    with pytest.raises((InputError, InputTypeError)) as error:
        TOOLS[tool].words(given, bench, 60.0)
    assert error.value.argument == argument
    assert argument in str(error.value)


def test_a_value_is_no_option_and_a_file_no_argument_of_another_kind(bench):
    words = TOOLS["identify"].words({"frequency": ["--force"], "frequency_bound": 0.03, "reduce": False}, bench, 60.0)
    assert words == [
        *(
            "identify",
            "--time-limit=54.0",
            "--frequency=--force",
            "--frequency-bound=0.03",
            "--no-reduce",
            "--json",
            "--",
        )
    ]
    assert TOOLS["verify"].words({"source": "-x"}, bench, 60.0)[-2:] == ["--", "-x"]


def test_files_are_named_by_paths_that_are_checked_and_nothing_replaces_them():
    for tool in TOOLS.values():
        for name, argument in tool.arguments.items():
            assert argument.kind is Path or "Written FILE" not in argument.help, f"{tool.name} {name}"
            assert name not in ("force", "loop", "auxiliary")
    known = {name for tool in TOOLS.values() for name in typing.get_type_hints(tool.command)}
    assert {"context", "as_json", "force", "static", "workers", "resume", "loop"} <= known & _LEFT_OUT


def test_a_call_ends_with_its_time_and_a_process_that_dies_is_said(bench, monkeypatch):
    class Process:
        def kill(self):
            self.killed = True

        def join(self):
            pass

    async def called(late):
        process, (receiver, sender) = Process(), Pipe(duplex=False)
        monkeypatch.setattr(server, "warm", lambda: None)
        monkeypatch.setattr(server, "started", lambda *_: (process, receiver))
        process.join = sender.close  # a process that has ended holds it no more
        if not late:
            sender.close()
        found = await server.Tools(bench, 0.05)._answer(None, "look", {"files": ["frf.csv"]})
        assert process.killed
        return checked(found)

    assert asyncio.run(called(True))["status"] == "stopped"
    assert asyncio.run(called(False))["status"] == "broken"


def test_serve_says_what_it_needs(run, monkeypatch, tmp_path):
    refused(run(["serve"]), "--mcp is missing")
    refused(run(["serve", "--mcp", "--folder", str(tmp_path / "none")]), "is no folder")
    monkeypatch.setitem(sys.modules, "mcp.server.lowlevel", None)
    refused(run(["serve", "--mcp"]), "pip install 'robustid[mcp]'")
