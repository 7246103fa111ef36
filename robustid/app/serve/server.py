"""The server: tools by the Model Context Protocol, for the one program that started it, over stdin and stdout."""

from __future__ import annotations

import importlib
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from robustid._version import __version__
from robustid.app.answers.form import Answer, ended, schema, text_of
from robustid.app.cli.main import BUG, MISUSE
from robustid.app.cli.steps import INTERRUPTED
from robustid.app.run.toml import is_array, is_table
from robustid.app.serve.process import started, warm
from robustid.app.serve.tools import TOOLS
from robustid.core import Options
from robustid.errors import InputError, InputTypeError

if TYPE_CHECKING:
    from mcp import types
    from mcp.server.context import ServerRequestContext

_INSTRUCTIONS = (
    "Models with a proof, for lightly damped machines, from measured files. Begin with look. Every answer has the same fields:"
    " status and sentence are the verdict, margin and guarantees are proved numbers, not_covered and assumed say what they do not"
    " hold for. Report them as they are. Nothing is guessed: an answer with status refused names in refusal the argument that is"
    " missing or wrong; ask whoever measured for it, and do not make it up. Paths are inside one folder; files are never"
    " overwritten: give another output."
)
_FAILED = ("refused", "stopped", "broken")


class Tools:
    """The tools of one folder; one call at a time, each with a time limit."""

    def __init__(self, folder: Path, limit: float) -> None:
        import anyio

        self._folder, self._limit = folder.resolve(), limit
        self._turn, self._context = anyio.Lock(), warm()

    async def listed(
        self, _: ServerRequestContext[Any], __: types.PaginatedRequestParams | None
    ) -> types.ListToolsResult:
        """The tools with the schemas of their arguments and answers."""
        from mcp import types

        found = _bare(schema())
        tools = [
            types.Tool(name=tool.name, description=tool.says, input_schema=tool.schema, output_schema=found)
            for tool in TOOLS.values()
        ]
        return types.ListToolsResult(tools=tools)

    async def called(
        self, context: ServerRequestContext[Any], asked: types.CallToolRequestParams
    ) -> types.CallToolResult:
        """The answer of a tool, as JSON and as the same text."""
        from mcp import types

        found = await self._answer(context, asked.name, asked.arguments or {})
        return types.CallToolResult(
            content=[types.TextContent(type="text", text=text_of(found))],
            structured_content=found,
            is_error=found["status"] in _FAILED,
        )

    async def _answer(self, context: ServerRequestContext[Any], name: str, given: Options) -> Answer:
        tool = TOOLS.get(name)
        if tool is None:
            return ended(name, "refused", f"there is no tool {name!r}; these are known: {', '.join(TOOLS)}", MISUSE)
        try:
            words = tool.words(given, self._folder, self._limit)
        except (InputError, InputTypeError) as error:
            return ended(tool.command.__name__, "refused", str(error), MISUSE, error)
        async with self._turn:
            return await self._carried_out(context, words)

    async def _carried_out(self, context: ServerRequestContext[Any], words: list[str]) -> Answer:
        """The answer of a command in its process, which ends with the call."""
        import anyio
        import anyio.to_thread

        process, told = await anyio.to_thread.run_sync(started, self._context, words, str(self._folder))
        count = 0
        try:
            with anyio.move_on_after(self._limit):
                while True:
                    kind, text = await anyio.to_thread.run_sync(told.recv, abandon_on_cancel=True)
                    if kind == "answer" and text:
                        return json.loads(text)
                    count += 1
                    await context.session.report_progress(count, None, text)
            late = f"stopped after the {self._limit:g} s of a call: ask for less, or start the server with a larger --time-limit"
            return ended(words[0], "stopped", late, INTERRUPTED)
        except EOFError:
            return ended(words[0], "broken", "its process ended without an answer: too little memory, perhaps", BUG)
        finally:
            process.kill()
            process.join()


def _bare(found: Any) -> Any:
    """A schema without its descriptions, which every tool would repeat: they are in the published one."""
    if is_table(found):
        return {name: _bare(one) for name, one in found.items() if name != "description"}
    return [_bare(one) for one in found] if is_array(found) else found


def serve(folder: Path, limit: float) -> None:
    """Serve until stdin ends."""
    try:
        import anyio

        for name in ("context", "lowlevel"):  # of version 2
            importlib.import_module(f"mcp.server.{name}")
    except ImportError:
        raise InputError(
            "robustid serve needs the package mcp, 2 or newer, which is not installed: pip install 'robustid[mcp]'"
        ) from None
    anyio.run(_serve, folder, limit)


async def _serve(folder: Path, limit: float) -> None:
    from mcp.server.lowlevel import Server
    from mcp.server.stdio import stdio_server

    async with stdio_server() as (read, write):  # first: what else writes to stdout goes to stderr from here on
        tools = Tools(folder, limit)
        server: Server[Any] = Server(
            "robustid",
            version=__version__,
            instructions=_INSTRUCTIONS,
            on_list_tools=tools.listed,
            on_call_tool=tools.called,
        )
        await server.run(read, write, server.create_initialization_options())
