"""Pictures of a drive: videos and image folders → numbered frames with their epochs.

:mod:`twin.frames.find` says which file or folder holds a camera's pictures, :mod:`twin.frames.pairing` brings
their number and that of the stamps together, :mod:`twin.frames.reading` decodes what is asked for. Nothing
is decoded before that.
"""
