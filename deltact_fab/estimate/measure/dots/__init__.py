"""Dots on a skin: sub-pixel centroids whose identities are kept over the frames.

The paper (Pattern Selection) separates the white dots by a colour filter and measures their
displacement by blob detection, as the reference for optical flow. A skin of sparse dark dots, the
markers of other sensors, is tracked in the same way.

Read in this order: `detect` (dots in one image), `skin` (neighbours), `identity` (matching blobs to
dots), `tracker`.
"""
