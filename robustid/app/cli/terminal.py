"""The terminal of a command: what it has printed counts, so that a result fits one screen."""

from __future__ import annotations

from collections.abc import Iterable

from rich.console import Console
from rich.text import Text

from robustid.app.cli.steps import Step, lasting, tell

LINES = 24  # of a terminal that nobody has made larger
_LEAST = 6  # lines of a result, however much was said before
_PASTE = "  "  # lines that begin so are pasted elsewhere: no line break comes into them


class Lasting:
    """Words of a step that are drawn with its seconds, at every turn of the spinner beside them; the drawing is told."""

    def __init__(self, words: str) -> None:
        self._words = words

    def __rich__(self) -> Text:
        tell(Step.text)
        return Text(lasting(self._words))


class Terminal(Console):
    """Console that counts its lines, but for those of steps, which a terminal replaces; `verbose`: everything is asked for."""

    def __init__(self, *, stderr: bool = False, verbose: bool = False) -> None:
        super().__init__(stderr=stderr)
        self.verbose = verbose
        self.lines = 0
        self.warned: list[str] = []  # sentences
        self.next: list[str] = []  # commands that were named

    @property
    def wraps(self) -> bool:
        """True where people read it: the lines of a file are broken by whoever shows them."""
        return self.is_terminal

    def say(self, text: str, head: str = "", style: str = "") -> None:
        """Print text, behind a head in a style; at a terminal lines break between words, but those that are pasted."""
        self.lines += self.lines_of(head + text)
        for k, line in enumerate(text.split("\n")):
            pasted = not self.wraps or line.startswith(_PASTE)
            self.print(Text.assemble(("" if k else head, style), line), highlight=False, soft_wrap=pasted)

    def lines_of(self, *texts: str) -> int:
        """Lines that texts take here."""
        return sum(len(Text(line).wrap(self, self.width)) or 1 for text in texts for line in text.split("\n"))

    def left(self, tail: Iterable[str]) -> int:
        """Lines of the screen that are left for a result, with these behind it and the prompt below."""
        return max(_LEAST, LINES - 1 - self.lines - self.lines_of(*tail))
