"""Pictures of a drive: videos and image folders → numbered frames with their epochs.

`find` says which file or folder holds a camera's pictures, `pairing` brings their number and that of the
stamps together, `read` decodes what is asked for. Nothing is decoded before that.
"""
