"""Norwegian sign faces, drawn by code: one description of shapes for the page and for rendered pictures.

- :func:`svg`: a sign as a small SVG picture
- :func:`face`: its description: size, outline, shapes → :class:`Face`
- :func:`painted`: the same as filled polygons, for those who render → :class:`Painted`

Drawn from scratch and simplified: recognisable, and no tracing of Statens vegvesen's own drawings.
"""

from twin.drawings.as_svg import svg
from twin.drawings.faces import face
from twin.drawings.polygons import Painted, painted
from twin.drawings.shapes import Face

__all__ = ["Face", "Painted", "face", "painted", "svg"]
