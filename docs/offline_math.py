"""Extension of Sphinx: mathematics as MathML, which browsers draw themselves; nothing is fetched."""

from __future__ import annotations

from typing import Any

from docutils import nodes
from docutils.utils.math import latex2mathml


def setup(app: Any) -> dict[str, Any]:
    """Make it the renderer of mathematics."""
    app.add_html_math_renderer("mathml", inline_renderers=(inline, None), block_renderers=(block, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def inline(writer: Any, node: nodes.math) -> None:
    """Render mathematics in a line."""
    writer.body.append(latex2mathml.tex2mathml(node.astext()))
    raise nodes.SkipNode


def block(writer: Any, node: nodes.math_block) -> None:
    """Render mathematics of its own."""
    text = node.astext().replace(r"\bar\sigma", r"\bar{\sigma}")
    writer.body.append(f'<div class="math">{latex2mathml.tex2mathml(text, as_block=True)}</div>')
    raise nodes.SkipNode
