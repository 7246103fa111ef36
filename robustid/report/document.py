"""The blocks of which a report is made, before any medium: `html` and `with_rich` each render every kind of block once.

A subject builds blocks; its page and its summary at the terminal are outlines of the same blocks.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Literal

from robustid.core import Unfinished
from robustid.identification import Check
from robustid.report.charts import Chart
from robustid.report.words import number

Role = Literal["", "soft", "caution", "warning"]
MOST_WARNINGS = 3  # on the first screen; the others stand in a part of their own
Kind = Literal["", "text", "n", "whole", "share"]


@dataclasses.dataclass(frozen=True)
class Heading:
    """Heading of a part (level 2) or of what stands in one (3); `guarantee`: the part says what is guaranteed."""

    text: str
    level: int = 2
    guarantee: bool = False


@dataclasses.dataclass(frozen=True)
class Text:
    """Paragraph; the words in `code` are set as those of a program; a `head`, such as "Warning", may stand before it."""

    text: str
    role: Role = ""
    id: str = ""
    code: tuple[str, ...] = ()
    head: str = ""


@dataclasses.dataclass(frozen=True)
class Verdict:
    """The outcome in one word and one sentence, with the numbers beside it; `key` chooses the colour.

    One that is `ahead` stands above the first of the others, which it qualifies; `more` are further words on it.
    """

    key: str
    word: str
    sentence: str
    numbers: tuple[tuple[str, str], ...] = ()
    id: str = "verdict"
    ahead: bool = False
    more: str = ""

    @property
    def words(self) -> str:
        """Word, sentence and numbers as text."""
        numbers = "; ".join(f"{name} {value}" for name, value in self.numbers)
        return f"{self.word}: {self.said}{f' ({numbers})' if numbers else ''}"

    @property
    def short(self) -> str:
        """Word and numbers as text."""
        numbers = "; ".join(f"{name} {value}" for name, value in self.numbers)
        return f"{self.word}{f' ({numbers})' if numbers else ''}"

    @property
    def said(self) -> str:
        """The sentence with the further words."""
        return f"{self.sentence} {self.more}".rstrip()


@dataclasses.dataclass(frozen=True)
class Facts:
    """Names with their words: (what, in which words)."""

    rows: Sequence[tuple[str, str]]


@dataclasses.dataclass(frozen=True)
class Column:
    """Head of a column (a line break: where it may break), a shorter one for the terminal, and what its cells hold.

    kind: "n" numbers; "text" long text, which may break anywhere; "whole" what never breaks; "share" numbers with a bar.
    """

    head: str
    kind: Kind = ""
    short: str = ""


@dataclasses.dataclass(frozen=True)
class Share:
    """Cell with a bar as long as the share."""

    text: str
    share: float


@dataclasses.dataclass(frozen=True)
class Table:
    """Rows of cells; `marks`: whether the claim of each row holds, `strong`: which rows stand out, `empty`: said where there are
    no rows.
    """

    columns: Sequence[Column]
    rows: Sequence[Sequence[str | Share]]
    marks: Sequence[bool] = ()
    strong: Sequence[bool] = ()
    empty: str = ""
    title: str = ""  # as the note: at the terminal, where no heading and no text stands beside the table
    note: str = ""
    most: int | None = None  # rows at the terminal; a page shows all


@dataclasses.dataclass(frozen=True)
class Drawing:
    """A chart in full size; `titled`: each of its figures under a heading; `beside`: in two columns."""

    chart: Chart
    titled: bool = False
    beside: bool = False


@dataclasses.dataclass(frozen=True)
class Grid:
    """Charts of many entries in columns; `small` ones under one legend for all."""

    charts: Sequence[Chart]
    columns: int
    small: bool = True
    titled: bool = True


@dataclasses.dataclass(frozen=True)
class Beside:
    """Parts beside each other where the window is wide enough."""

    parts: Sequence[Sequence[Block]]


@dataclasses.dataclass(frozen=True)
class Code:
    """Text whose line breaks stay."""

    text: str
    id: str = ""


Block = Heading | Text | Verdict | Facts | Table | Drawing | Grid | Beside | Code


@dataclasses.dataclass(frozen=True)
class Glance:
    """First screen below the verdict: numbers (what, how much), the result in words, the one plot, what to do next.

    Below the words stands what is `not_covered`.
    """

    numbers: Sequence[tuple[str, str]] = ()
    words: str = ""
    chart: Chart | None = None
    next: Sequence[Text] = ()
    not_covered: str = ""


@dataclasses.dataclass(frozen=True)
class Part:
    """A heading with what stands under it, folded until it is opened."""

    title: str
    blocks: Sequence[Block]


@dataclasses.dataclass(frozen=True)
class Document:
    """A page: its title, verdicts and warnings, the rest of its first screen, its body, and its last lines.

    A `notice` is said before the verdict, which stays on the first screen.
    """

    title: str
    head: Sequence[Block]
    body: Sequence[Block]
    foot: Sequence[Text] = ()
    glance: Glance = Glance()
    notice: Text | None = None

    @property
    def ahead(self) -> list[Verdict]:
        """Verdicts that stand above the first of the others."""
        return [block for block in self.head if isinstance(block, Verdict) and block.ahead]

    @property
    def verdict(self) -> Verdict | None:
        """The verdict that comes first, but for those ahead of it."""
        return next((block for block in self.head if isinstance(block, Verdict) and not block.ahead), None)

    @property
    def numbers(self) -> list[tuple[str, str]]:
        """Numbers of the first screen, with those of its verdict that are none of them."""
        shown = list(self.glance.numbers)
        values = {value for _, value in shown} | {value.removeprefix("≤ ") for _, value in shown}
        own = () if self.verdict is None else self.verdict.numbers
        return shown + [one for one in own if one[1] not in values]

    @property
    def warnings(self) -> list[str]:
        """Everything at the head that warns, verdicts beside the first one too."""
        return [words for block in self.head if (words := self._warning(block))]

    def _warning(self, block: Block) -> str:
        """Words of a block that warns; none of another one."""
        if isinstance(block, Verdict):
            first = block.ahead or block is self.verdict
            return block.words if not first and block.key != "consistent" else ""
        return block.text if isinstance(block, Text) and block.role == "warning" else ""

    @property
    def beside(self) -> list[Block]:
        """Everything at the head that doesn't warn, but for the verdict and those ahead of it."""
        first = [*self.ahead, self.verdict]
        return [block for block in self.head if block not in first and not self._warning(block)]

    @property
    def parts(self) -> list[Part]:
        """The body by its headings; blocks before the first one stand under the heading "Details"."""
        found: list[Part] = []
        for block in self.body:
            if isinstance(block, Heading) and block.level == 2:
                found.append(Part(block.text, []))
            else:
                found = found or [Part("Details", [])]
                found[-1] = Part(found[-1].title, [*found[-1].blocks, block])
        return found

    def blocks(self) -> Iterator[Block]:
        """Every block in its order, those beside each other one after another."""
        first = [Drawing(self.glance.chart)] if self.glance.chart is not None else []
        todo = [
            *([] if self.notice is None else [self.notice]),
            *self.head,
            *first,
            *self.glance.next,
            *self.body,
            *self.foot,
        ]
        while todo:
            block = todo.pop(0)
            if isinstance(block, Beside):
                todo = [inner for part in block.parts for inner in part] + todo
            else:
                yield block


def checked_by_another(proved: Mapping[str, bool] | None) -> list[Verdict]:
    """Verdict of another program on the proofs of what the names say; none where it was not asked."""
    if not proved:
        return []
    word, not_proved = "Checked by another program", [name for name, holds in proved.items() if not holds]
    if not_proved:
        sentence = f"robustid-proof, which counts in exact integers, does not prove {' and '.join(not_proved)}."
        return [Verdict("failed", "Not proved by another program", sentence, id="independent", ahead=True)]
    sentence = f"robustid-proof, which counts in exact integers, proves {' and '.join(proved)} too."
    return [Verdict("consistent", word, sentence, id="independent")]


def checks_table(checks: Sequence[Check]) -> Table:
    """Claims with their numbers and limits, and whether they hold."""
    rows = [(check.name, number(check.measured), number(check.limit, 6)) for check in checks]
    columns = [Column("Claim"), Column("Number", "n"), Column("Limit", "n")]
    return Table(columns, rows, marks=[bool(check.holds) for check in checks], title="Verification")


def of_numbers(*heads: str) -> list[Column]:
    """Columns of numbers under these heads."""
    return [Column(head, "n") for head in heads]


def proved(holds: bool, sentence: str, otherwise: str, id: str) -> Verdict:
    """Verdict on claims that were evaluated again for a page."""
    return Verdict(*(("consistent", "Proved", sentence) if holds else ("failed", "Not proved", otherwise)), id=id)


def certificates(count: int, hold: bool, id: str) -> Verdict:
    """Verdict on certificates, which support their bounds now or don't."""
    sentence = (
        f"All {count} certificates were evaluated again for this page, without a solver: each supports its bound."
    )
    otherwise = (
        f"Not all of the {count} certificates support their bounds, evaluated again for this page: without its certificate"
        " a number is what a solver returned, not a bound. `robustid verify` names which; compute them again."
    )
    return proved(hold, sentence, otherwise, id)


def unfinished_notice(unfinished: Unfinished | None) -> Text | None:
    """Words that come first on the page of a run that ended before its end; None of others."""
    return None if unfinished is None else Text(unfinished.sentence, "warning", "unfinished", head=unfinished.word)


def pasted(steps: Iterable[tuple[str, str]]) -> list[Text]:
    """Next steps that are commands, each behind what it is for."""
    return [Text(f"{what[0].upper()}{what[1:]}: {command}", code=(command,)) for what, command in steps]
