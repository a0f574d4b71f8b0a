"""Equations as pictures, drawn at build time: nothing is loaded."""

from __future__ import annotations

from xml.etree import ElementTree

TEXT = 16  # px: an em, of which the sizes are multiples
SIZE = 18  # px: letters of the equations' font are small


def drawn(tex: str, inline: bool) -> str:
    """SVG of an equation in the text's colour, as large as the text, read out as TeX."""
    import ziamath

    ziamath.config.svg2 = False  # no glyph by reference: ids of several equations would collide
    equation = ziamath.Latex(tex, size=SIZE, inline=inline, color="currentColor")
    svg = equation.svgxml()
    sizes = {side: float(svg.attrib.pop(side)) for side in ("width", "height")}
    if inline:
        sizes["vertical-align"] = equation.getyofst()
    style = "; ".join(f"{what}: {size / TEXT:.3f}em" for what, size in sizes.items())
    svg.attrib |= {"role": "img", "aria-label": tex, "style": style}
    return ElementTree.tostring(svg, encoding="unicode")


def _inline(self, node):
    from docutils.nodes import SkipNode

    self.body.append(f'<span class="equation">{drawn(node.astext(), True)}</span>')
    raise SkipNode


def _block(self, node):
    from docutils.nodes import SkipNode

    self.body.append(f'<div class="equation">{drawn(node.astext(), False)}</div>\n')
    raise SkipNode


def setup(app) -> dict:
    """Register the renderer."""
    app.add_html_math_renderer(
        "drawn", inline_renderers=(_inline, None), block_renderers=(_block, None)
    )
    return {"parallel_read_safe": True, "parallel_write_safe": True}
