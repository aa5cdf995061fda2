"""What the site needs beyond Markdown: equations as MathML, and Sphinx roles of docstrings as plain code.

Equations are written as GitHub shows them: a fenced block ``math``, or ``$`…`$`` within a line.
"""

import re

from latex2mathml.converter import convert

BLOCK = re.compile(r"^```math\n(.*?)^```$", re.MULTILINE | re.DOTALL)
INLINE = re.compile(r"\$`([^`]+)`\$")
ROLE = re.compile(r":(?:func|class|meth|mod|data|attr):<code>(~?)([\w.]+)</code>")


def on_page_markdown(markdown: str, **_: object) -> str:
    """Equations become MathML, which browsers draw by themselves."""
    markdown = BLOCK.sub(
        lambda found: f'<div class="equation">{convert(found[1].strip(), display="block")}</div>', markdown
    )
    return INLINE.sub(lambda found: convert(found[1]), markdown)


def on_page_content(html: str, **_: object) -> str:
    """``:func:`~a.b.c``` of a docstring becomes ``c``."""
    return ROLE.sub(lambda found: f"<code>{found[2].rpartition('.')[2] if found[1] else found[2]}</code>", html)
